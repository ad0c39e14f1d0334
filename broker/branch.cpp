#include "broker/branch.hpp"

#include "common/base/assert.hpp"
#include "common/protocol/content_hash.hpp"

#include <algorithm>
#include <utility>

namespace fraja::broker {

using worker::SessionIndex;

namespace {

/// Which codes a session takes for the scene's fault and which for this machine's.
ErrorCode code_of(protocol::FailureCode code) {
    switch (code) {
    case protocol::FailureCode::scene:
        return ErrorCode::invalid_scene;
    case protocol::FailureCode::cancelled:
        return ErrorCode::cancelled;
    case protocol::FailureCode::machine:
        break;
    }
    return ErrorCode::io;
}

} // namespace

/// It is compiled where it is drawn.
void Branch::perform(SessionIndex session, worker::CompileScene action) {
    Blob text = joined(action.chunks);
    if (protocol::content_hash(text) != action.scene)
        return results_.push_back(
            {session, worker::SceneFailed{
                          action.scene,
                          {ErrorCode::malformed_frame,
                           "the scene's bytes do not have the hash they were asked for by"}}});
    Scene& scene = scenes_[action.scene];
    scene.text = std::move(text);
    scene.wanted_by.insert(session);
    results_.push_back({session, worker::SceneCompiled{action.scene}});
}

void Branch::perform(SessionIndex session, const worker::StartTile& action) {
    const JobId id = new_id();
    orders_[id] = {session, action.ticket, action.rect, action.settings.pixel_bytes()};
    order_of_[action.ticket] = id;
    events_.push_back(Ordered{{.id = id,
                               .pass = action.pass,
                               .rect = action.rect,
                               .scene = action.scene,
                               .scene_text = scenes_.at(action.scene).text,
                               .settings = action.settings,
                               .probe_side = action.probe_side}});
}

void Branch::perform(SessionIndex, const worker::StopTile& action) {
    const auto order = order_of_.find(action.ticket);
    if (order == order_of_.end())
        return; // it is done
    events_.push_back(OrderWithdrawn{order->second});
    orders_.erase(order->second);
    order_of_.erase(order);
}

void Branch::perform(SessionIndex session, const worker::ForgetScene& action) {
    const auto scene = scenes_.find(action.scene);
    if (scene != scenes_.end() && scene->second.wanted_by.erase(session) > 0 &&
        scene->second.wanted_by.empty())
        scenes_.erase(scene);
}

std::vector<worker::PoolResult> Branch::take_results() {
    return std::exchange(results_, {});
}

std::vector<worker::TileProgress> Branch::progress(SessionIndex session) const {
    std::vector<worker::TileProgress> progress;
    for (const OrderProgress& order : progress_())
        if (const auto given = orders_.find(order.id);
            given != orders_.end() && given->second.session == session)
            progress.push_back({given->second.ticket, order.rays});
    return progress;
}

std::vector<Event> Branch::take_events() {
    return std::exchange(events_, {});
}

/// To the broker above, one of `branch_threads` has drawn it.
void Branch::take(const OrderFilled& filled, std::uint64_t threads) {
    const auto order = orders_.find(filled.id);
    if (order == orders_.end())
        return; // it was withdrawn meanwhile
    const Given given = order->second;
    orders_.erase(order);
    order_of_.erase(given.ticket);
    const double power = static_cast<double>(std::max<std::uint64_t>(threads, 1)) / branch_threads;
    const auto elapsed = from_seconds(seconds(filled.render_time) / power);
    std::vector<Blob> blobs = filled.probe;
    if (!filled.parts.empty()) {
        protocol::PixelPlanes pixels(given.rect, given.pixel_bytes);
        for (const auto& part : filled.parts)
            pixels.place(part->rect, part->blobs);
        blobs = pixels.blobs(given.rect);
    }
    results_.push_back({given.session, worker::TileFinished{given.ticket, filled.rays, elapsed,
                                                            std::move(blobs)}});
}

void Branch::take(const OrderFailed& failed) {
    const auto order = orders_.find(failed.id);
    if (order == orders_.end())
        return;
    results_.push_back(
        {order->second.session,
         worker::TileBroken{order->second.ticket, {code_of(failed.code), failed.reason}}});
    order_of_.erase(order->second.ticket);
    orders_.erase(order);
}

JobId Branch::new_id() {
    JobId id;
    do {
        for (std::size_t i = 0; i < id.bytes.size(); i += 8)
            for (std::uint64_t bits = rng_.next(), b = 0; b < 8; ++b)
                id.bytes[i + b] = static_cast<std::uint8_t>(bits >> (8 * b));
    } while (id == JobId{} || orders_.contains(id));
    return id;
}

} // namespace fraja::broker
