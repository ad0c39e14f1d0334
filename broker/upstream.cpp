#include "broker/upstream.hpp"

#include "common/net/clock.hpp"

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

void Upstream::connect(Instant now) {
    if (done_ || now < again_at_)
        return;
    auto socket = net::DealerSocket::connect(context_, options_.broker);
    if (!socket) {
        on_log_({LogLevel::error, "upstream_unreachable", {}, socket.error().message});
        again_at_ = now + pause_after_trouble;
        return;
    }
    branch_ = std::make_unique<Branch>(progress_, fresh_rng());
    leaving_ = false;
    link_ = std::make_unique<worker::Link>(
        worker::Link::Who{worker::SessionIndex{}, options_.broker}, on_log_, std::move(*socket),
        worker::Session({random_id<WorkerId>(), options_.name, branch_threads, options_.tags},
                        worker::Limits{}),
        *branch_);
}

std::vector<Event> Upstream::serve(Instant now, std::uint64_t threads) {
    threads_ = threads;
    if (!link_ && threads > 0)
        connect(now);
    if (!link_)
        return {};
    if (threads == 0 && !std::exchange(leaving_, true))
        link_->step(worker::StopNow{}); // somebody else draws it sooner
    link_->receive_some();
    for (auto results = branch_->take_results(); !results.empty();
         results = branch_->take_results())
        for (const worker::PoolResult& result : results)
            link_->step(result.event);
    link_->keep_time(now);
    std::vector<Event> events = branch_->take_events();
    let_go_if_over(now);
    return events;
}

void Upstream::let_go_if_over(Instant now) {
    if (!link_->over(now))
        return;
    done_ = *link_->finished() == worker::FinishReason::dismissed ||
            *link_->finished() == worker::FinishReason::version_mismatch;
    link_.reset();
}

void Upstream::leave() {
    if (!link_)
        return;
    if (!std::exchange(leaving_, true))
        link_->step(worker::StopNow{});
    for (Instant now = net::now(); !link_->over(now); now = net::now()) {
        link_->receive_some();
        link_->keep_time(now);
        (void)branch_->take_events(); // the dispatcher is over
        net::wait({link_->socket()}, link_->next_deadline() - now);
    }
    link_.reset();
}

Instant Upstream::next_deadline() const {
    if (link_)
        return link_->next_deadline();
    return done_ || threads_ == 0 ? Instant::never() : again_at_;
}

} // namespace fraja::broker
