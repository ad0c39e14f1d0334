#include "common/http/server.hpp"

#include "common/base/assert.hpp"
#include "common/http/peer.hpp"
#include "common/http/workers.hpp"
#include "common/net/clock.hpp"
#include "common/net/waker.hpp"

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <exception>
#include <map>
#include <mutex>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <thread>
#include <unistd.h>
#include <utility>
#include <vector>

namespace fraja::http {
namespace {

constexpr Duration accept_pause = std::chrono::milliseconds(100); // where there is no descriptor
constexpr int keepalive_idle_s = 60, keepalive_interval_s = 10;   // nine probes: 150 s in all

enum class PeerId : std::uint64_t {};

/// Of one viewer.
struct Lines {
    PeerId peer;
    std::shared_ptr<LineSource> source;
    std::string text = {};
    bool failed = false;
};

/// What workers have done, until the loop takes it.
struct Done {
    std::vector<std::pair<PeerId, Reply>> replies;
    std::vector<Lines> lines;
    bool has_looked = false; ///< for lines
};

int poll_timeout(Instant until, Instant now) {
    if (until == Instant::never())
        return -1;
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(until - now).count();
    return static_cast<int>(std::clamp<std::int64_t>(left, 0, 60'000));
}

} // namespace

class Server::Loop {
public:
    Loop(Listener listener, Setup setup)
        : listener_(std::move(listener)), setup_(std::move(setup)),
          refusals_(refusals(setup_.limits, setup_.always)) {}

    ~Loop() {
        stopping_ = true;
        waker_.wake();
        if (thread_.joinable())
            thread_.join();
        close(listener_.fd);
    }
    Loop(const Loop&) = delete;
    Loop& operator=(const Loop&) = delete;

    void serve() {
        FRAJA_ASSERT(!workers_);
        workers_ = std::make_unique<Workers>(setup_.limits.threads);
        thread_ = std::jthread([this] { run(); });
    }

    [[nodiscard]] const Address& address() const { return listener_.address; }

private:
    void run() {
        while (!stopping_) {
            std::erase_if(peers_,
                          [](const auto& entry) { return entry.second.stage() == Stage::over; });
            wait();
            const Instant now = net::now();
            see_to_peers(now);
            take_what_is_done(now);
            if (accepts_ && now >= accept_due_)
                accept_one(now);
            for (auto& [id, peer] : peers_)
                if (auto request = peer.take_request())
                    post(id, *std::move(request));
            look(now);
        }
        peers_.clear();
    }

    /// Until there is something to do. What a descriptor is ready for is then in `polled_`: waker,
    /// listener, and the peers in their order.
    void wait() {
        const Instant now = net::now();
        const bool listens = now >= accept_due_;
        Instant until = listens ? Instant::never() : accept_due_;
        polled_.assign({{waker_.fd(), POLLIN, 0}, {listens ? listener_.fd : -1, POLLIN, 0}});
        bool anybody_looks = false;
        for (const auto& [id, peer] : peers_) {
            const short events = peer.events();
            polled_.push_back({events != 0 ? peer.fd() : -1, events, 0});
            until = std::min(until, peer.deadline());
            anybody_looks |= peer.wants_lines() != nullptr;
        }
        if (anybody_looks && !looking_)
            until = std::min(until, look_due_);
        poll(polled_.data(), polled_.size(), poll_timeout(until, now));
        accepts_ = polled_[1].revents != 0;
    }

    void see_to_peers(Instant now) {
        auto polled = polled_.begin() + 2;
        for (auto& [id, peer] : peers_) {
            if (const short events = (polled++)->revents; events != 0)
                peer.ready(events, now);
            if (now >= peer.deadline())
                peer.expire(now);
        }
    }

    void take_what_is_done(Instant now) {
        waker_.drain();
        Done done;
        {
            const std::lock_guard lock(mutex_);
            done = std::exchange(done_, {});
        }
        for (auto& [id, reply] : done.replies) { // nobody goes while being answered
            const bool is_one_too_many = reply.lines && streams() >= setup_.limits.streams_max;
            if (reply.lines)
                look_due_ = now; // whoever comes sees something at once
            peers_.at(id).reply(is_one_too_many ? refusals_.streams_full : std::move(reply), now);
        }
        for (Lines& lines : done.lines) {
            const auto found = peers_.find(lines.peer);
            if (found == peers_.end() || !found->second.wants_lines())
                continue;
            if (lines.failed)
                found->second.end(now);
            else
                found->second.lines(std::move(lines.text), now);
        }
        if (done.has_looked)
            looking_ = false;
    }

    [[nodiscard]] std::size_t streams() const {
        return static_cast<std::size_t>(std::ranges::count_if(
            peers_, [](const auto& entry) { return entry.second.has_lines(); }));
    }

    /// One at a time: those who are there already are seen to in between.
    void accept_one(Instant now) {
        const int fd = accept4(listener_.fd, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
        if (fd >= 0)
            return welcome(fd, now);
        const bool has_gone = errno == EAGAIN || errno == EINTR || errno == ECONNABORTED;
        if (!has_gone && !give_one_up()) // no descriptor, or no memory
            accept_due_ = now + accept_pause;
    }

    void welcome(int fd, Instant now) {
        const int yes = 1;
        setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
        // A machine that is gone without a word does not keep a stream for ever.
        setsockopt(fd, SOL_SOCKET, SO_KEEPALIVE, &yes, sizeof yes);
        setsockopt(fd, IPPROTO_TCP, TCP_KEEPIDLE, &keepalive_idle_s, sizeof keepalive_idle_s);
        setsockopt(fd, IPPROTO_TCP, TCP_KEEPINTVL, &keepalive_interval_s,
                   sizeof keepalive_interval_s);
        const auto has_room = [&] { return peers_.size() < setup_.limits.connections_max; };
        while (!has_room() && give_one_up()) {
        }
        const bool is_welcome = has_room();
        const auto added =
            peers_.try_emplace(PeerId{next_id_++}, fd, setup_.limits, refusals_, now);
        if (is_welcome) // a request is there already, mostly
            added.first->second.ready(POLLIN, now);
        else // one more, then, who is the first to go
            added.first->second.reply(refusals_.no_room, now);
    }

    /// Whoever keeps this waiting; false: nobody does.
    bool give_one_up() {
        const auto first = std::ranges::min_element(peers_, {}, [](const auto& entry) {
            return std::pair(entry.second.stage(), entry.second.since());
        });
        if (first == peers_.end() || first->second.stage() >= Stage::answering)
            return false;
        peers_.erase(first);
        return true;
    }

    void post(PeerId id, std::string request) {
        workers_->post([this, id, request = std::move(request)] {
            Reply reply = exchange(request, setup_.answer, setup_.always);
            deliver([&](Done& done) { done.replies.emplace_back(id, std::move(reply)); });
        });
    }

    /// Asks for the lines of all who have taken those before, in one worker: however many look,
    /// they are in the way of one request.
    void look(Instant now) {
        if (looking_ || now < look_due_)
            return;
        std::vector<Lines> viewers;
        for (const auto& [id, peer] : peers_)
            if (auto source = peer.wants_lines())
                viewers.push_back({id, std::move(source)});
        if (viewers.empty())
            return;
        looking_ = true;
        look_due_ = now + setup_.limits.look_pause;
        workers_->post([this, viewers = std::move(viewers)]() mutable {
            for (Lines& lines : viewers)
                try {
                    lines.text = lines.source->next(net::now());
                } catch (const std::exception&) {
                    lines.failed = true;
                }
            deliver([&](Done& done) {
                done.lines = std::move(viewers);
                done.has_looked = true;
            });
        });
    }

    template <class Add>
    void deliver(Add add) {
        {
            const std::lock_guard lock(mutex_);
            add(done_);
        }
        waker_.wake();
    }

    const Listener listener_;
    const Setup setup_;
    const Refusals refusals_;
    const net::Waker waker_;
    std::atomic<bool> stopping_ = false;

    // The loop's own.
    std::map<PeerId, Peer> peers_;
    std::vector<pollfd> polled_;
    std::uint64_t next_id_ = 0;
    bool accepts_ = false, looking_ = false;
    Instant accept_due_{}, look_due_{};

    std::mutex mutex_; // guards `done_`
    Done done_;

    std::unique_ptr<Workers> workers_; // they use what is above
    std::jthread thread_;
};

Server::Server(std::unique_ptr<Loop> loop) : loop_(std::move(loop)) {}
Server::Server(Server&&) noexcept = default;
Server& Server::operator=(Server&&) noexcept = default;
Server::~Server() = default;

Result<Server> Server::bind(const Address& address, Setup setup) {
    auto listener = listen_at(address);
    if (!listener)
        return listener.error();
    return Server(std::make_unique<Loop>(*std::move(listener), std::move(setup)));
}

void Server::serve() {
    loop_->serve();
}

const Address& Server::address() const {
    return loop_->address();
}

} // namespace fraja::http
