#include "tests/sim/client_node.hpp"

#include "client/submission.hpp"
#include "client/watching.hpp"
#include "common/protocol/content_hash.hpp"
#include "common/protocol/passes.hpp"
#include "tests/sim/pixels.hpp"

#include <algorithm>
#include <string>
#include <utility>
#include <variant>

namespace fraja::sim {

using namespace std::chrono_literals;

namespace {

Bytes scene_of(std::size_t size, std::size_t index) {
    Bytes scene(size);
    for (std::size_t b = 0; b < scene.size(); ++b)
        scene[b] = static_cast<std::byte>(b * 7 + index + b / 251);
    return scene;
}

} // namespace

// -------------------------------------------------------------------------------------- any core

CoreRunner::CoreRunner(Farm& farm, const Sites& sites, std::uint64_t name)
    : farm_(farm), name_(name) {
    process_.tick = [this] { step(client::Tick{}); };
    for (const auto& site : sites) {
        Way& way = *ways_.emplace_back(std::make_unique<Way>(*site, process_));
        way.line.hear = [this](protocol::Message&& message) {
            step(client::FromBroker{std::move(message)});
        };
        // Its socket has found the broker again by itself: nothing that the core hears of.
        way.line.reconnected = [this, &way] {
            way.site.network.in_process(process_, [this] { step(client::Tick{}); });
        };
        way.subscriber.hear = [this](const protocol::Message& message) {
            step(client::FromStream{message});
        };
    }
}

std::vector<Node> CoreRunner::lines() {
    std::vector<Node> all;
    for (const auto& way : ways_)
        all.push_back({&way->line, &way->site.network});
    return all;
}

void CoreRunner::start(std::unique_ptr<client::Core> core,
                       std::function<void(const client::News&)> on_news) {
    close();
    ways_.front()->site.network.begin_life(process_);
    core_ = std::move(core);
    on_news_ = std::move(on_news);
    std::vector<client::Action> actions;
    core_->start(farm_.now(), actions);
    perform(actions);
}

/// Both sockets.
void CoreRunner::close() {
    for (const auto& way : ways_) {
        way->site.stream.open(way->subscriber);
        way->site.network.disconnect(way->line);
        ++way->line.socket;
    }
    way_ = nullptr;
}

void CoreRunner::step(const client::Event& event) {
    if (!process_.running)
        return;
    farm_.note(name_ + event.index());
    std::vector<client::Action> actions;
    core_->step(farm_.now(), event, actions);
    perform(actions);
}

void CoreRunner::perform(std::vector<client::Action>& actions) {
    for (std::size_t k = 0; k < actions.size() && process_.running; ++k) {
        client::Action action = std::move(actions[k]);
        if (!std::visit([this](auto& a) { return perform(std::move(a)); }, action))
            core_->step(farm_.now(), client::NotSent{}, actions);
    }
    if (process_.running)
        ways_.front()->site.network.wake(process_, core_->next_deadline());
}

bool CoreRunner::perform(client::Connect&& connect) {
    close();
    const auto found = std::ranges::find_if(
        ways_, [&](const auto& way) { return way->site.endpoint == connect.broker; });
    if (found == ways_.end()) {
        farm_.violation("a client looks for a broker at " + connect.broker);
        return true;
    }
    way_ = found->get();
    way_->site.network.connect(way_->line);
    return true;
}
bool CoreRunner::perform(client::Speak&&) {
    farm_.violation("a client speaks another version, of which nobody is");
    return true;
}
bool CoreRunner::perform(client::Look&& look) {
    farm_.violation("a client looks for brokers by " + look.source);
    return true;
}
bool CoreRunner::perform(client::StopLooking&&) {
    return true;
}
bool CoreRunner::perform(client::OpenStream&&) {
    way_->site.stream.open(way_->subscriber);
    return true;
}
bool CoreRunner::perform(client::Subscribe&& subscribe) {
    way_->site.stream.subscribe(way_->subscriber, subscribe.topic);
    return true;
}
bool CoreRunner::perform(client::Unsubscribe&& unsubscribe) {
    way_->site.stream.unsubscribe(way_->subscriber, unsubscribe.topic);
    return true;
}
bool CoreRunner::perform(client::Send&& send) {
    return way_ && way_->site.network.to_broker(way_->line, send.message);
}
bool CoreRunner::perform(client::News&& news) {
    if (std::holds_alternative<client::Finished>(news)) {
        close();
        ways_.front()->site.network.end_life(process_);
    }
    on_news_(news);
    return true;
}

// --------------------------------------------------------------------------------- one with a job

ClientNode::ClientNode(Farm& farm, const Sites& sites, std::size_t index)
    : farm_(farm), sites_(sites), index_(index), runner_(farm, sites, 3'000 + 100 * index) {}

/// It may know all brokers, or only one, which tells of the others.
client::SessionOptions ClientNode::session_options() {
    std::vector<std::string> brokers = endpoints_of(sites_);
    std::rotate(brokers.begin(),
                brokers.begin() + static_cast<std::ptrdiff_t>(farm_.rng.below(brokers.size())),
                brokers.end());
    return {std::move(brokers), 1h, "sim"};
}

void ClientNode::start() {
    const JobPlan& plan = farm_.scenario.jobs[index_];
    const Blob scene(scene_of(plan.scene_bytes, index_));
    job_ = {.job = farm_.make_id<JobId>(),
            .job_name = "job " + std::to_string(index_),
            .scene = protocol::content_hash(scene),
            .scene_bytes = scene.size(),
            .settings = plan.settings,
            .tile_side = plan.tile_side,
            .order = plan.order,
            .priority = plan.priority,
            .wishes = plan.wishes,
            .resume = false};
    farm_.submitted[job_.job] = {job_, index_, scene};
    farm_.plan_of_scene[job_.scene] = index_;
    farm_.report.jobs[index_].submitted_at = farm_.now().since_start;
    client::SubmissionRequest request{
        .job = job_, .scene_text = scene, .session = session_options(), .timeout = {}};
    runner_.start(std::make_unique<client::Submission>(std::move(request), Rng(farm_.rng.next())),
                  [this](const client::News& news) { take(news); });
}

void ClientNode::watch() {
    watching_ = true;
    client::WatchRequest request{
        .job = to_string(job_.job), .session = session_options(), .until = {}};
    runner_.start(std::make_unique<client::JobWatching>(std::move(request), Rng(farm_.rng.next())),
                  [this](const client::News& news) { take(news); });
}

void ClientNode::take(const client::News& news) {
    if (const auto* accepted = std::get_if<client::Accepted>(&news))
        begin_following(accepted->state);
    else if (const auto* tile = std::get_if<client::TileArrived>(&news))
        take(tile->tile);
    else if (const auto* withdrawn = std::get_if<client::TilesWithdrawn>(&news))
        take(*withdrawn);
    else if (const auto* changed = std::get_if<client::StateChanged>(&news))
        checks_ = changed->state.checks;
    else if (const auto* finished = std::get_if<client::Finished>(&news))
        finish(finished->outcome);
}

void ClientNode::begin_following(const protocol::JobState& state) {
    JobReport& report = farm_.report.jobs[index_];
    // Of several brokers one that was cut off may have kept it alone.
    if (report.acknowledged && !watching_ && farm_.scenario.store.there &&
        farm_.scenario.brokers == 1)
        violation("was acknowledged, and has to be submitted again");
    if (!report.acknowledged)
        report.acknowledged_at = farm_.now().since_start;
    report.acknowledged = true;
    grid_ = protocol::CellGrid(job_.settings.crop, state.cell_side);
    have_.assign(state.cell_count, false); // whoever begins anew is given all anew
    wrong_.clear();
    checks_ = state.checks;
}

void ClientNode::take(const protocol::TileDone& tile) {
    ++farm_.report.tiles;
    const auto cells = grid_.cells(tile.rect);
    std::uint64_t fresh = 0;
    if (cells)
        (void)grid_.all_of(*cells, [&](std::uint64_t cell) {
            const std::size_t bit = tile.pass * grid_.count() + cell;
            fresh += !have_.at(bit);
            have_[bit] = true;
            return true;
        });
    if (fresh == 0)
        violation("is given a tile twice");
    else
        farm_.report.useful_rays += farm_.scenario.jobs[index_].work.rays(tile.rect) *
                                    static_cast<double>(fresh) /
                                    static_cast<double>(cells->count());
    if (!farm_.scenario.pixels ||
        are_pixels_of({job_.scene, job_.settings, tile.pass}, tile.rect, tile.blobs))
        return;
    if (!has_liars(farm_.scenario))
        violation("is given wrong pixels");
    else if (cells)
        (void)grid_.all_of(*cells, [&](std::uint64_t cell) {
            wrong_.insert(tile.pass * grid_.count() + cell);
            return true;
        });
}

void ClientNode::take(const client::TilesWithdrawn& withdrawn) {
    for (const PixelRect& rect : withdrawn.rects)
        (void)grid_.all_of(grid_.cells(rect).value(), [&](std::uint64_t cell) {
            if (!have_.at(cell))
                violation("is told that a tile does not count which it was not given");
            have_[cell] = false;
            wrong_.erase(cell);
            return true;
        });
}

/// Of a job whose tiles are not all checked, or where it was said that some could not be.
bool ClientNode::may_be_wrong() const {
    return job_.wishes.verify < 1 || checks_.unchecked > 0;
}

void ClientNode::finish(const client::Outcome& outcome) {
    JobReport& report = farm_.report.jobs[index_];
    report.outcome = outcome.reason;
    farm_.log("client " + std::to_string(index_) + " is through: " + outcome.reason);
    if (outcome.code == client::ExitCode::cancelled && report.acknowledged)
        return farm_.agenda.after(2s, [this] { watch(); }); // it will be tried again
    if (outcome.code == client::ExitCode::usage && !report.acknowledged)
        return farm_.agenda.after(5s,
                                  [this] { start(); }); // the disk was full; somebody tries again
    if (outcome.code == client::ExitCode::no_such_job && farm_.scenario.brokers > 1)
        return farm_.agenda.after(2s, [this] { watch(); }); // it was asked for at one that lacks it
    over_ = true;
    if (outcome.code == client::ExitCode::done)
        look_whether_whole();
}

/// All that is wanted of it: of a job with a time limit the first pass.
void ClientNode::look_whether_whole() {
    JobReport& report = farm_.report.jobs[index_];
    report.done = true;
    report.done_at = farm_.now().since_start;
    const auto end = job_.settings.limited_in_time()
                         ? have_.begin() + static_cast<std::ptrdiff_t>(grid_.count())
                         : have_.end();
    if (have_.empty() || !std::all_of(have_.begin(), end, [](bool cell) { return cell; }))
        violation("is done without all its pixels");
    report.wrong_cells = wrong_.size();
    report.unchecked_tiles = checks_.unchecked;
    if (!wrong_.empty() && !may_be_wrong())
        violation("is done with wrong pixels");
}

void ClientNode::violation(const std::string& what) {
    farm_.violation("job " + std::to_string(index_) + " " + what);
}

} // namespace fraja::sim
