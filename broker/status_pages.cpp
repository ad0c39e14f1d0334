#include "broker/status_pages.hpp"

#include "broker/health.hpp"
#include "broker/metrics.hpp"
#include "common/net/clock.hpp"

namespace fraja::broker {
namespace {

http::Answer metrics(const Board& board, const std::filesystem::path& state) {
    const auto report = board.latest();
    return {.type = metrics_content_type,
            .body = http::body(metrics_text({report.get(), process_usage(),
                                             state.empty() ? std::nullopt : store_usage(state)}))};
}

http::Answer health(const Health& now) {
    return {.status = now.is_well ? 200 : 503,
            .type = "application/json",
            .body = http::body(to_json(now))};
}

} // namespace

Result<http::Address> status_address(std::string_view text, bool insecure) {
    const auto to_bind = net::endpoint_to_bind(text, net::http_port, true);
    if (!to_bind)
        return to_bind.error();
    const auto endpoint = net::parse_endpoint(*to_bind, net::http_port);
    if (!endpoint)
        return endpoint.error();
    if (endpoint->transport != net::Endpoint::Transport::tcp)
        return Error{ErrorCode::invalid_argument,
                     "'" + std::string(text) + "' is no address and port, as 127.0.0.1:50059"};
    if (!insecure && !net::is_loopback(*endpoint))
        return Error{ErrorCode::invalid_argument,
                     to_string(*endpoint) +
                         " can be reached from other machines, and pages have no keys: use a "
                         "loopback address, or say --insecure on a network you trust"};
    return http::address_of(*endpoint);
}

http::Answerer status_pages(const Board& board, std::filesystem::path state) {
    return [&board, state = std::move(state)](const http::Request& request) {
        if (request.method != "GET" && request.method != "HEAD") {
            http::Answer refused = http::refusal(405, "only GET and HEAD are answered here");
            refused.allow = "GET, HEAD";
            return refused;
        }
        if (request.path == "/metrics")
            return metrics(board, state);
        if (request.path == "/healthz")
            return health(health_of(board.latest().get(), net::now()));
        if (request.path == "/livez")
            return health(liveness_of(board.latest().get(), net::now()));
        return http::refusal(404, "there is no such page; there is /healthz /livez /metrics");
    };
}

} // namespace fraja::broker
