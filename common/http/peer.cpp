#include "common/http/peer.hpp"

#include "common/base/assert.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <linux/sockios.h>
#include <poll.h>
#include <string_view>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>
#include <utility>

namespace fraja::http {
namespace {

/// Where the library sees a head's end: at the first line with nothing but its end.
constexpr std::string_view head_end = "\n\r\n";

} // namespace

Peer::Peer(int fd, const Limits& limits, const Refusals& refusals, Instant now)
    : fd_(fd), limits_(limits), refusals_(refusals), since_(now) {}

Peer::~Peer() {
    close(fd_);
}

short Peer::events() const {
    switch (stage_) {
    case Stage::leaving:
    case Stage::idle:
    case Stage::asking:
        return POLLIN;
    case Stage::sending:
        return POLLOUT;
    case Stage::streaming: // who has closed looks no longer
        return static_cast<short>(POLLIN | (unsent_.empty() ? 0 : POLLOUT));
    case Stage::answering:
    case Stage::over:
        break;
    }
    return 0;
}

Instant Peer::deadline() const {
    switch (stage_) {
    case Stage::idle:
        return since_ + limits_.idle_max;
    case Stage::asking:
        return since_ + limits_.request_time_max;
    case Stage::leaving:
    case Stage::sending:
        return since_ + limits_.patience;
    case Stage::streaming:
        return unsent_.empty() ? Instant::never() : since_ + limits_.patience;
    case Stage::answering:
    case Stage::over:
        break;
    }
    return Instant::never();
}

void Peer::ready(short events, Instant now) {
    if (!unsent_.empty() && (events & ~POLLIN) != 0)
        send(now);
    if ((this->events() & POLLIN) != 0 && (events & ~POLLOUT) != 0)
        receive(now);
}

void Peer::expire(Instant now) {
    if (stage_ == Stage::asking)
        return reply(refusals_.too_late, now);
    // The socket is ready for more when a third of what it holds is gone, and over a slow line that
    // may be megabytes.
    const int before = std::exchange(under_way_bytes_, under_way_bytes());
    if (!unsent_.empty() && under_way_bytes_ < before)
        since_ = now;
    else
        end(now);
}

void Peer::end(Instant now) {
    enter(Stage::over, now);
}

std::optional<std::string> Peer::take_request() {
    if (request_.empty())
        return std::nullopt;
    return std::exchange(request_, {});
}

void Peer::reply(Reply reply, Instant now) {
    if (!reply.head || reply.head->empty())
        return end(now);
    enter(Stage::sending, now);
    keeps_ = reply.keeps;
    lines_ = std::move(reply.lines);
    unsent_.push_back(std::move(reply.head));
    if (reply.body && !reply.body->empty())
        unsent_.push_back(std::move(reply.body));
    send(now);
}

std::shared_ptr<LineSource> Peer::wants_lines() const {
    return stage_ == Stage::streaming && unsent_.empty() ? lines_ : nullptr;
}

void Peer::lines(std::string text, Instant now) {
    FRAJA_ASSERT(stage_ == Stage::streaming && unsent_.empty());
    if (text.empty())
        return;
    since_ = now;
    unsent_.push_back(body(std::move(text)));
    send(now);
}

void Peer::enter(Stage stage, Instant now) {
    stage_ = stage;
    since_ = now;
}

void Peer::receive(Instant now) {
    std::array<char, 4096> bytes;
    const ssize_t size = recv(fd_, bytes.data(), bytes.size(), 0);
    if (size < 0 && (errno == EAGAIN || errno == EINTR))
        return;
    if (size <= 0)
        return end(now);
    if (stage_ == Stage::leaving || stage_ == Stage::streaming)
        return; // too late to say anything
    if (stage_ == Stage::idle)
        enter(Stage::asking, now);
    received_.append(bytes.data(), static_cast<std::size_t>(size));
    look_for_request(now);
}

void Peer::look_for_request(Instant now) {
    if (std::min(received_.find('\n'), received_.size()) > limits_.request_line_bytes_max)
        return reply(refusals_.line_too_long, now);
    const std::size_t end = received_.find(head_end);
    const bool is_whole = end != std::string::npos;
    const std::size_t size = is_whole ? end + head_end.size() : received_.size();
    if (size > limits_.request_bytes_max)
        return reply(refusals_.request_too_large, now);
    if (!is_whole)
        return;
    request_ = received_.substr(0, size);
    received_.erase(0, size);
    enter(Stage::answering, now);
}

void Peer::send(Instant now) {
    while (!unsent_.empty()) {
        const std::string& text = *unsent_.front();
        const int more = unsent_.size() > 1 ? MSG_MORE : 0;
        const ssize_t size =
            ::send(fd_, text.data() + sent_bytes_, text.size() - sent_bytes_, MSG_NOSIGNAL | more);
        if (size < 0 && (errno == EAGAIN || errno == EINTR))
            return;
        if (size <= 0)
            return end(now);
        since_ = now;
        under_way_bytes_ = under_way_bytes();
        sent_bytes_ += static_cast<std::size_t>(size);
        if (sent_bytes_ < text.size())
            return;
        sent_bytes_ = 0;
        unsent_.pop_front();
    }
    if (stage_ == Stage::sending)
        all_sent(now);
}

int Peer::under_way_bytes() const {
    int bytes = 0;
    return ioctl(fd_, SIOCOUTQ, &bytes) == 0 ? bytes : 0;
}

void Peer::all_sent(Instant now) {
    if (lines_)
        return enter(Stage::streaming, now);
    if (!keeps_) {
        // What the other end is still sending would reset a closed connection, and it might not see
        // its answer.
        shutdown(fd_, SHUT_WR);
        return enter(Stage::leaving, now);
    }
    enter(received_.empty() ? Stage::idle : Stage::asking, now);
    if (!received_.empty())
        look_for_request(now);
}

} // namespace fraja::http
