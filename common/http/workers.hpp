// Workers: so many threads, and what they are to do.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace fraja::http {

/// How much waits is bounded by who posts.
class Workers {
public:
    explicit Workers(std::size_t threads);
    /// Waits for what has begun; the rest is never done.
    ~Workers();
    Workers(const Workers&) = delete;
    Workers& operator=(const Workers&) = delete;

    /// Does not throw. Any thread.
    void post(std::function<void()> work);

private:
    void run();

    std::mutex mutex_; // guards what follows
    std::condition_variable changed_;
    std::deque<std::function<void()>> waiting_;
    bool stopping_ = false;
    std::vector<std::jthread> threads_; // last: they use the rest
};

} // namespace fraja::http
