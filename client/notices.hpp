// Notices: what is said once, beside the progress and in the form that was chosen for it.
#pragma once

#include "client/console.hpp"
#include "client/options.hpp"
#include "client/reaching.hpp"
#include "client/shell.hpp"
#include "common/protocol/messages.hpp"

#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

namespace fraja::client {

/// Who has not answered by then is told.
inline constexpr Duration unanswered_max = std::chrono::seconds(2);
/// What takes no longer is not worth a word.
inline constexpr Duration unsaid_max = std::chrono::seconds(1);

/// A message at level info; with --progress json instead a line of fraja.event/1.
void tell(Console& console, ProgressMode mode, std::string_view event, const std::string& text);

/// Says that a broker is looked for: on a terminal in the line that is redrawn, with --progress
/// none not at all. `mode` must not be automatic; the console must outlive this.
class SearchNotice {
public:
    SearchNotice(Console& console, ProgressMode mode, std::vector<std::string> brokers,
                 Instant now);
    /// Says it if that is due, and what hinders where that is known by then. Returns when it wants
    /// to be called next.
    Instant tick(Instant now);
    /// It was found, or nobody looks any more: the redrawn line is clear again.
    void end();
    /// Says, once, that a broker is known by its own word alone.
    void warn_of(const std::string& broker);

private:
    void say(const std::vector<std::string>& hindrances);

    Console& console_;
    ProgressMode mode_;
    std::vector<std::string> brokers_;
    Instant due_, said_by_ = Instant::never();
    std::unique_ptr<Reaching> reaching_; ///< from when it is due until it is said
    bool drawn_ = false, warned_ = false;
};

/// Says that the broker was lost, and whether it was that one which answers then. The console must
/// outlive this.
class LossNotice {
public:
    explicit LossNotice(Console& console) : console_(console) {}
    void update(const ConnectionChanged& news);

private:
    Console& console_;
    std::optional<std::string> lost_; ///< the endpoint, until one answers
};

/// Says, once, which of the workers that --direct names nobody answers at.
class AnswerNotice {
public:
    AnswerNotice(Console& console, std::vector<std::string> workers, Instant now);
    /// Says it if that is due. Returns when it wants to be called next.
    Instant tick(Instant now);

private:
    Console& console_;
    std::vector<std::string> workers_;
    Instant due_;
    std::unique_ptr<Reaching> reaching_;
};

/// Says why a job waits, and that it goes on; with --progress none nothing. `mode` and `console` as
/// above.
class WaitNotice {
public:
    WaitNotice(Console& console, ProgressMode mode) : console_(console), mode_(mode) {}
    /// `cure`: what to do where no worker is connected.
    void update(Instant now, const protocol::JobState& job, const std::string& cure);
    /// Says it if that is due. Returns when it wants to be called next.
    Instant tick(Instant now);

private:
    Console& console_;
    ProgressMode mode_;
    std::string text_;          ///< empty: it does not wait
    bool lacks_worker_ = false; ///< and waits for that
    bool said_ = false;
    Instant due_ = Instant::never();
};

/// Says of each worker once that it answers wrong pixels. The console must outlive this.
class DistrustNotice {
public:
    explicit DistrustNotice(Console& console) : console_(console) {}
    void update(const protocol::JobState& job);
    /// What was withdrawn for another reason.
    void update(const TilesWithdrawn& withdrawn);

private:
    Console& console_;
    std::set<WorkerId> told_;
};

/// Says that fewer brokers keep a job than stand for each other, when that changes, and that all do
/// again; with --progress none no more than that a single one does. `mode` and `console` as above.
class CopiesNotice {
public:
    CopiesNotice(Console& console, ProgressMode mode) : console_(console), mode_(mode) {}
    /// Jobs of a film say the same, and it is said once.
    void update(Instant now, const protocol::JobState& job);
    /// Says it if that is due. Returns when it wants to be called next.
    Instant tick(Instant now);
    /// The program follows it no more: that copies lack is said now, or never.
    void end();

private:
    struct Copies {
        std::uint32_t here = 0, wanted = 0;
        [[nodiscard]] bool lack() const { return here < wanted; }
        friend bool operator==(const Copies&, const Copies&) = default;
    };
    void tell_unless_none(std::string_view event, const std::string& text);

    Console& console_;
    ProgressMode mode_;
    Copies now_, said_;
    Instant due_ = Instant::never();
};

/// What is to be said of a job that is done whose tiles were not all checked that should be; empty:
/// nothing.
[[nodiscard]] std::string unchecked_words(const protocol::CheckCounts& checks);

/// What --resume found: `job`, or that alone which was `submitted`.
void tell_resumed(Console& console, ProgressMode mode, const protocol::JobState& job,
                  JobId submitted);

/// What goes on without this program, and how to look after it: said at every --log-level.
void tell_parting(Console& console, ProgressMode mode, const std::string& text);

/// How a worker is started for a broker.
[[nodiscard]] std::string worker_cure(const std::string& broker);

/// A listener with a SearchNotice in front of it, until a broker is reached for the first time.
class SearchingListener final : public Listener {
public:
    SearchingListener(Listener& listener, SearchNotice notice)
        : listener_(listener), notice_(std::move(notice)) {}

    void hear(Instant now, const News& news) override;
    Instant tick(Instant now) override;
    void wait_also(std::vector<net::Waitable>& all) const override { listener_.wait_also(all); }
    std::optional<Outcome> wants_to_leave() override { return listener_.wants_to_leave(); }

private:
    Listener& listener_;
    SearchNotice notice_;
};

} // namespace fraja::client
