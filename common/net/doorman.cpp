#include "common/net/doorman.hpp"

#include "common/net/clock.hpp"
#include "common/net/frames.hpp"

#include <array>
#include <chrono>
#include <utility>

namespace fraja::net {
namespace {

constexpr const char* zap_endpoint = "inproc://zeromq.zap.01";
constexpr std::size_t request_frames = 9; // envelope, delimiter, version, ... mechanism, key
constexpr Duration told_interval = std::chrono::minutes(10);
constexpr std::size_t strangers_told_max = 1'000; // within that

/// Empty: it is none.
std::string z85(const std::string& key) {
    std::array<char, key_characters + 1> text{};
    if (key.size() != key_bytes ||
        !zmq_z85_encode(text.data(), reinterpret_cast<const std::uint8_t*>(key.data()), key_bytes))
        return {};
    return text.data();
}

} // namespace

Doorman::Doorman(zmq::context_t& context, AllowList list)
    : socket_(context, zmq::socket_type::router),
      list_(std::make_shared<const AllowList>(std::move(list))),
      told_(told_interval, strangers_told_max) {
    socket_.set(zmq::sockopt::linger, 0);
    socket_.set(zmq::sockopt::rcvhwm, 0); // a question that is not answered is a peer that waits
    socket_.set(zmq::sockopt::sndhwm, 0);
    socket_.bind(zap_endpoint);
    thread_ = std::jthread([this] { serve(); });
}

void Doorman::replace(AllowList list) {
    auto fresh = std::make_shared<const AllowList>(std::move(list));
    const std::lock_guard lock(mutex_);
    list_.swap(fresh);
}

std::shared_ptr<const AllowList> Doorman::list() const {
    const std::lock_guard lock(mutex_);
    return list_;
}

AllowList::Holder Doorman::holder(const char* user_id) const {
    const std::string key = user_id ? user_id : "";
    if (auto known = list()->find(key))
        return known;
    return std::make_shared<protocol::KeyHolder>(protocol::KeyHolder{key, {}, {}});
}

std::uint64_t Doorman::refused_count() const {
    const std::lock_guard lock(mutex_);
    return refused_count_;
}

std::vector<Stranger> Doorman::take_strangers() {
    const std::lock_guard lock(mutex_);
    return std::exchange(strangers_, {});
}

void Doorman::serve() {
    try {
        std::vector<std::string> request;
        for (;;) {
            request.clear();
            zmq::message_t part;
            do {
                try {
                    (void)socket_.recv(part);
                } catch (const zmq::error_t& e) {
                    if (e.num() != EINTR)
                        throw;
                    continue;
                }
                if (request.size() <= request_frames)
                    request.push_back(part.to_string());
            } while (request.empty() || part.more());
            answer(request);
        }
    } catch (const zmq::error_t&) { // the context is shut down
        socket_.close();
    }
}

void Doorman::answer(const std::vector<std::string>& request) {
    if (request.size() < 8)
        return; // libzmq itself asks: never
    const std::string &door = request[4], &address = request[5], &mechanism = request[7];
    const std::string key =
        mechanism == "CURVE" && request.size() == request_frames ? z85(request[8]) : "";
    const std::string objected = objection(door, key);
    if (!objected.empty())
        note({key, address, objected});
    const bool welcome = objected.empty();
    const std::array<std::string_view, 7> reply = {request[0],
                                                   "",
                                                   "1.0",
                                                   request[3],
                                                   welcome ? "200" : "400",
                                                   welcome ? "OK" : "refused",
                                                   welcome ? std::string_view(key)
                                                           : std::string_view()};
    for (const std::string_view part : reply)
        send_text(socket_, part, true);
    send_text(socket_, {}, false);
}

/// Empty: it may come in.
std::string Doorman::objection(std::string_view door, const std::string& key) const {
    const auto holder = key.empty() ? nullptr : list()->find(key);
    if (!holder)
        return "nobody knows it";
    const bool fits = door == stream_door ? holder->roles.has_any(protocol::client_roles)
                      : door == call_door ? holder->roles.has_any(protocol::caller_roles)
                                          : !holder->roles.empty();
    if (fits)
        return {};
    return "it is that of " + holder->name + ", and lacks the role " +
           protocol::alternatives(door == stream_door ? protocol::client_roles
                                                      : protocol::caller_roles) +
           (door == stream_door ? " to follow the stream" : " to call a worker");
}

void Doorman::note(Stranger stranger) {
    const std::lock_guard lock(mutex_);
    ++refused_count_;
    if (told_.is_new(now(), stranger.key + stranger.why))
        strangers_.push_back(std::move(stranger));
}

} // namespace fraja::net
