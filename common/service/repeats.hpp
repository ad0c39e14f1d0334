// Repeats: which of many like events are told, and which are only counted, so that nobody, whatever
// he does, can flood a log.
#pragma once

#include "common/base/instant.hpp"
#include "common/base/log_line.hpp"

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace fraja::service {

/// So many at once; then one in every interval, which saves up to `burst` again.
struct Allowance {
    std::uint32_t burst = 1;
    Duration interval = std::chrono::seconds(1);
};

struct RepeatLimits {
    /// Of one kind about one subject: a worker that comes and goes, or strangers' rubbish.
    Allowance subject{5, std::chrono::seconds(10)};
    /// Of one kind about any: a whole farm may come at once, but not again and again.
    Allowance kind{20'000, std::chrono::seconds(1)};
};

/// An event to be told, and how many like it were only counted before it.
struct Told {
    LogLine line;
    std::uint64_t more = 0;
};

class Repeats {
public:
    explicit Repeats(RepeatLimits limits = {}) : limits_(limits) {}

    /// Nothing: the event is counted. Events without a kind are always told, and those of
    /// level debug: whoever asks for these wants each, when it happens.
    [[nodiscard]] std::optional<Told> take(Instant now, LogLine line);
    /// Of those that were counted, and may be told by now, the last of each kind and subject.
    [[nodiscard]] std::vector<Told> due(Instant now);
    /// Of all that were counted, in the end.
    [[nodiscard]] std::vector<Told> rest();

    /// Subjects that are remembered: not those that have been quiet.
    [[nodiscard]] std::size_t subject_count() const;

private:
    struct Tally {
        Instant free_at{}; ///< when nothing of it is used any more
        std::uint64_t untold = 0;
        LogLine last{}; ///< of the untold

        [[nodiscard]] bool has_room(Instant now, const Allowance& allowance) const;
        void use(Instant now, const Allowance& allowance);
        void count(LogLine line);
        [[nodiscard]] Told tell();
    };
    struct Kind {
        Tally all;
        std::map<std::string, Tally> subjects;
    };

    RepeatLimits limits_;
    std::map<std::string_view, Kind> kinds_;
};

} // namespace fraja::service
