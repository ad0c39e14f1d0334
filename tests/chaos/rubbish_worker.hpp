// A worker that says hello as it should, and answers with everything but pixels.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <string>
#include <thread>

namespace fraja::chaos {

/// What it does with a tile. Pixels that are wrong and as many as they should be are not among
/// these: nobody can tell them from others by looking at one answer.
enum class Misdeed : std::uint8_t {
    wrong_size,   ///< too few bytes, or too many
    wrong_tile,   ///< an answer for another tile
    wrong_job,    ///< for a job that does not exist
    failure,      ///< "my machine is broken"
    cancellation, ///< of what nobody cancelled
    no_message,   ///< bytes
    twice,        ///< two answers
    silence,      ///< it beats, has the tile, and traces no ray
    denial,       ///< it beats, and never heard of the tile
    flight,       ///< it leaves, without a word
};
inline constexpr std::size_t misdeed_count = 10;

/// Its sessions last some seconds; then it comes back under another name. A thread of its own.
class RubbishWorker {
public:
    RubbishWorker(std::string endpoint, std::uint64_t seed);

    [[nodiscard]] std::uint64_t sessions() const { return sessions_; }
    [[nodiscard]] std::uint64_t count(Misdeed misdeed) const {
        return counts_[static_cast<std::size_t>(misdeed)];
    }

private:
    void run(const std::stop_token& stop, const std::string& endpoint, std::uint64_t seed);

    std::atomic<std::uint64_t> sessions_ = 0;
    std::array<std::atomic<std::uint64_t>, misdeed_count> counts_{};
    std::jthread thread_;
};

} // namespace fraja::chaos
