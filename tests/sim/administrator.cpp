#include "tests/sim/administrator.hpp"

#include <chrono>
#include <string>
#include <variant>

namespace fraja::sim {

using namespace std::chrono_literals;
using protocol::JobDeed;
using protocol::WorkerDeed;

namespace {

std::string described(const client::Question& wish) {
    if (const auto* worker = std::get_if<client::WorkerQuestion>(&wish))
        return worker->worker + (worker->deed == WorkerDeed::drain ? " drain" : " undrain");
    const auto& job = std::get<client::JobQuestion>(wish);
    constexpr const char* deeds[] = {"cancel", "pause", "resume", "retry", "set priority"};
    return job.job + " " + deeds[static_cast<std::size_t>(*job.deed)];
}

} // namespace

Administrator::Administrator(Farm& farm, const Sites& sites,
                             const std::vector<std::unique_ptr<ClientNode>>& clients)
    : farm_(farm), sites_(sites), clients_(clients), runner_(farm, sites, 9'000) {}

void Administrator::meddle() {
    if (!wishes_.empty() || runner_.is_running())
        return;
    wishes_.push_back(any_wish());
    ask_next();
}

client::Question Administrator::any_wish() {
    if (farm_.rng.below(2) == 0)
        return client::WorkerQuestion{
            "worker " + std::to_string(farm_.rng.below(farm_.scenario.workers.size())),
            farm_.rng.below(2) == 0 ? WorkerDeed::drain : WorkerDeed::undrain};
    const std::size_t i = farm_.rng.below(clients_.size());
    const JobId job = clients_[i]->job();
    // A job that a broker without a store has forgotten is not submitted again once it was
    // cancelled: its client has left.
    constexpr JobDeed deeds[] = {JobDeed::pause,        JobDeed::resume, JobDeed::set_priority,
                                 JobDeed::set_priority, JobDeed::cancel, JobDeed::retry};
    const bool may_cancel = farm_.scenario.store.there && farm_.report.jobs[i].acknowledged;
    const JobDeed deed = deeds[farm_.rng.below(may_cancel ? 6 : 4)];
    return client::JobQuestion{to_string(job), deed, static_cast<std::int32_t>(farm_.rng.below(4))};
}

void Administrator::undo_all() {
    for (const auto& client : clients_)
        for (const JobDeed deed : {JobDeed::resume, JobDeed::retry})
            wishes_.push_back(client::JobQuestion{to_string(client->job()), deed});
    for (std::size_t i = 0; i < farm_.scenario.workers.size(); ++i)
        wishes_.push_back(
            client::WorkerQuestion{"worker " + std::to_string(i), WorkerDeed::undrain});
    if (!runner_.is_running())
        ask_next();
}

void Administrator::ask_next() {
    if (wishes_.empty() || runner_.is_running())
        return;
    runner_.start(std::make_unique<client::Asking>(
                      wishes_.front(), client::SessionOptions{endpoints_of(sites_), 1h, "ctl"}),
                  [this](const client::News& news) {
                      if (!std::holds_alternative<client::Finished>(news))
                          return;
                      farm_.log("administrator: " + described(wishes_.front()) + ": " +
                                std::get<client::Finished>(news).outcome.reason);
                      wishes_.pop_front();
                      farm_.agenda.after(1ms, [this] { ask_next(); });
                  });
}

} // namespace fraja::sim
