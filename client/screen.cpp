#include "client/screen.hpp"

#include "client/columns.hpp"

namespace fraja::client {

Screen::Screen(Outlet& outlet) : outlet_(outlet), keys_(RawKeys::take()) {
    outlet_.put("\x1b[?1049h\x1b[?25l\x1b[2J"); // the other screen, no cursor, nothing on it
}

Screen::~Screen() {
    outlet_.put("\x1b[?2026l\x1b[0m\x1b[?25h\x1b[?1049l");
    outlet_.pump();
}

void Screen::draw(const std::vector<std::string>& lines) {
    const Window size = window();
    std::string text = "\x1b[?2026h\x1b[H"; // shown at once, by a terminal that knows how
    for (std::size_t i = 0; i < lines.size(); ++i) {
        text += (i > 0 ? "\r\n" : "") + lines[i];
        // At the right edge, clearing would take the last character.
        if (columns_of(lines[i]) < size.columns)
            text += "\x1b[K";
    }
    outlet_.put(text + "\x1b[J\x1b[?2026l");
}

} // namespace fraja::client
