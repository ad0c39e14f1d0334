#include "broker/status_pages.hpp"

#include "broker/health.hpp"
#include "broker/metrics.hpp"
#include "common/net/clock.hpp"

namespace fraja::broker {

HttpServer::Pages status_pages(const Board& board, std::filesystem::path state) {
    const auto metrics = [&board, state = std::move(state)] {
        const auto report = board.latest();
        return HttpPage{200, metrics_content_type,
                        metrics_text({report.get(), process_usage(),
                                      state.empty() ? std::nullopt : store_usage(state)})};
    };
    const auto health = [&board] {
        const Health now = health_of(board.latest().get(), net::now());
        return HttpPage{now.is_well ? 200 : 503, "application/json", to_json(now)};
    };
    return {{"/metrics", metrics}, {"/healthz", health}};
}

} // namespace fraja::broker
