// What systemd's journal wants of lines that it reads from stderr.
#pragma once

#include "common/base/log_line.hpp"

#include <string_view>

namespace fraja::service {

/// Whether the journal itself reads what is written to `fd`, as $JOURNAL_STREAM says, see
/// systemd.exec(5): a child whose stderr goes elsewhere has that variable as well.
[[nodiscard]] bool goes_to_journal(int fd);

/// What opens a line there, "<4>" for a warning: the journal takes it away and keeps it as the
/// line's priority, see sd-daemon(3).
[[nodiscard]] std::string_view journal_prefix(LogLevel level);

} // namespace fraja::service
