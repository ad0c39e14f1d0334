// Waker: how another thread wakes a poll loop.
#pragma once

namespace fraja::net {

/// `wake` may be called from any thread and from a signal handler; the rest by the loop's thread.
class Waker {
public:
    Waker();
    ~Waker();
    Waker(const Waker&) = delete;
    Waker& operator=(const Waker&) = delete;

    void wake() const;
    /// Forgets the wakes so far; call before looking at what they were about.
    void drain() const;
    [[nodiscard]] int fd() const { return fd_; }

private:
    int fd_;
};

} // namespace fraja::net
