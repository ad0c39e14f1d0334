#include "broker/upstream.hpp"

#include "common/net/clock.hpp"
#include "common/net/endpoint.hpp"

#include <algorithm>
#include <chrono>
#include <utility>

namespace fraja::broker {
namespace {

using namespace std::chrono_literals;

constexpr Duration pause_after_trouble = 5s; // an endpoint that cannot be connected to at all

} // namespace

Upstream::Upstream(const net::Context& context, const UpstreamOptions& options,
                   std::function<std::vector<OrderProgress>()> progress, const OnLog& on_log)
    : context_(context), options_(options), progress_(std::move(progress)),
      on_log_([&on_log](LogLine line) {
          line.text = "upstream " + line.text;
          if (on_log)
              on_log(line);
      }) {}

Result<net::DealerSocket> Upstream::connect(const std::string& told) {
    const auto endpoint = net::endpoint_to_connect(told, net::broker_port);
    if (!endpoint)
        return endpoint.error();
    return net::DealerSocket::connect(context_, *endpoint);
}

void Upstream::begin(Instant now) {
    if (done_ || now < again_at_)
        return;
    std::vector<net::DealerSocket> sockets;
    for (const std::string& endpoint : options_.brokers) {
        auto socket = connect(endpoint);
        if (!socket) {
            on_log_({LogLevel::error, "upstream_unreachable", {}, socket.error().message});
            again_at_ = now + pause_after_trouble;
            return;
        }
        sockets.push_back(std::move(*socket));
    }
    branch_ = std::make_unique<Branch>(progress_, fresh_rng());
    leaving_ = false;
    worker::CrewWires::Host& host = *this;
    worker::CrewOptions crew;
    crew.identity = {random_id<WorkerId>(), options_.name, branch_threads, options_.tags};
    crew.endpoints = options_.brokers;
    wires_ = std::make_unique<worker::CrewWires>(std::move(crew), "", on_log_, *branch_, host);
    for (std::size_t slot = 0; slot < sockets.size(); ++slot)
        wires_->add_line(slot, std::move(sockets[slot]), options_.brokers[slot]);
}

std::vector<Event> Upstream::serve(Instant now, std::uint64_t threads) {
    threads_ = threads;
    if (!wires_ && threads > 0)
        begin(now);
    if (!wires_)
        return {};
    if (threads == 0 && !std::exchange(leaving_, true))
        wires_->step(worker::StopNow{}); // somebody else draws it sooner
    wires_->keep_time(now);
    hand_out_results();
    std::vector<Event> events = branch_->take_events();
    let_go_if_over();
    return events;
}

void Upstream::hand_out_results() {
    for (auto results = branch_->take_results(); !results.empty();
         results = branch_->take_results())
        for (worker::PoolResult& result : results)
            wires_->step(worker::SessionEvent{result.session, std::move(result.event)});
}

void Upstream::let_go_if_over() {
    if (!wires_->is_over())
        return;
    const worker::FinishReason reason = *wires_->crew().finished();
    done_ = reason == worker::FinishReason::dismissed ||
            reason == worker::FinishReason::version_mismatch;
    wires_.reset();
}

void Upstream::leave() {
    if (!wires_)
        return;
    if (!std::exchange(leaving_, true))
        wires_->step(worker::StopNow{});
    while (true) {
        const Instant now = net::now();
        wires_->keep_time(now);
        (void)branch_->take_events(); // the dispatcher is over
        if (wires_->is_over())
            break;
        std::vector<net::Waitable> waitables;
        for (const net::Socket* socket : wires_->sockets())
            waitables.emplace_back(*socket);
        net::wait(waitables, wires_->next_deadline() - now);
    }
    wires_.reset();
}

std::vector<const net::Socket*> Upstream::sockets() const {
    return wires_ ? wires_->sockets() : std::vector<const net::Socket*>();
}

Instant Upstream::next_deadline() const {
    if (wires_)
        return wires_->next_deadline();
    return done_ || threads_ == 0 ? Instant::never() : again_at_;
}

} // namespace fraja::broker
