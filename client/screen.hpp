// Screen: a terminal's whole window, drawn anew without flicker, and given back as it was.
#pragma once

#include "client/outlet.hpp"
#include "client/terminal.hpp"

#include <optional>
#include <string>
#include <vector>

namespace fraja::client {

class Screen {
public:
    /// Takes the terminal that `outlet`, which must outlive this, writes to.
    explicit Screen(Outlet& outlet);
    ~Screen(); ///< what was there before is there again, with its cursor
    Screen(const Screen&) = delete;
    Screen& operator=(const Screen&) = delete;

    [[nodiscard]] Window window() const { return window_of(outlet_.fd()); }
    /// Shows these lines and nothing else: not more than the window has, none wider.
    void draw(const std::vector<std::string>& lines);
    /// Whether `q` was pressed since this was asked.
    [[nodiscard]] bool was_left() const { return keys_ && keys_->has_left(); }
    /// Keys can be waited for at stdin.
    [[nodiscard]] bool has_keys() const { return keys_.has_value(); }

private:
    Outlet& outlet_;
    std::optional<RawKeys> keys_;
};

} // namespace fraja::client
