// The directory of a broker's state, and the lock that keeps it to one broker.
#pragma once

#include "common/base/result.hpp"

#include <filesystem>

namespace fraja::broker {

/// A directory that is this process's until the lock ends, however it ends.
class StateLock {
public:
    /// Makes the directory where there is none, for its owner alone. Error io: it cannot be made or
    /// written to, or another broker has it.
    [[nodiscard]] static Result<StateLock> take(const std::filesystem::path& directory);

    StateLock(StateLock&& other) noexcept;
    StateLock& operator=(StateLock&& other) noexcept;
    ~StateLock();

private:
    explicit StateLock(int fd) : fd_(fd) {}
    int fd_;
};

} // namespace fraja::broker
