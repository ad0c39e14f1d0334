// ProgressReport: shows a job's progress on the console in the way the user chose.
#pragma once

#include "client/console.hpp"
#include "client/options.hpp"
#include "client/progress.hpp"

namespace fraja::client {

class ProgressReport {
public:
    /// `mode` must not be automatic: see chosen(). The console must outlive this.
    ProgressReport(Console& console, ProgressMode mode, Instant now);

    /// A bar on a terminal, lines elsewhere.
    [[nodiscard]] static ProgressMode chosen(ProgressMode mode, const Console& console);

    void update(const protocol::JobState& state);
    void set_connected(bool connected);
    /// Says what is due. Returns when it wants to be called next.
    Instant tick(Instant now);
    /// Says how it stands at the end.
    void finish(Instant now);

    [[nodiscard]] const ProgressView& view() const { return meter_.view(); }

private:
    Console& console_;
    ProgressMode mode_;
    ProgressMeter meter_;
    PlainPace pace_;
    bool known_ = false;   ///< there was an update
    bool changed_ = false; ///< since it was shown
    Instant shown_{};
};

} // namespace fraja::client
