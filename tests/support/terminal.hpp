// A terminal for programs under test: what they draw is kept, keys are typed, the window changes.
#pragma once

#include "common/base/instant.hpp"
#include "common/base/pixel_rect.hpp"

#include <string>
#include <string_view>
#include <vector>

namespace fraja {

/// A pseudo-terminal. It understands nothing: what is drawn is a text with escapes.
class Terminal {
public:
    /// `size` in columns and rows. Aborts where the system has none.
    explicit Terminal(Extent size);
    ~Terminal();
    Terminal(const Terminal&) = delete;
    Terminal& operator=(const Terminal&) = delete;

    /// The command that runs `argv` at this terminal, as a shell would: its Ctrl-C is a signal.
    [[nodiscard]] std::vector<std::string> command(const std::vector<std::string>& argv) const;

    /// Takes in what is drawn until `words` are in it, at or behind the place where the last wait
    /// ended; false when the time is up or nothing more can come.
    [[nodiscard]] bool wait_for(std::string_view words, Duration timeout);
    /// The same, until the program has left the terminal.
    [[nodiscard]] bool wait_for_end(Duration timeout);
    void type(std::string_view keys);
    void resize(Extent size);

    /// What was drawn so far.
    [[nodiscard]] const std::string& text() const { return text_; }
    /// Whether keys are shown and read by lines, as a shell expects it.
    [[nodiscard]] bool is_sane() const;

private:
    /// False: nothing more can come.
    bool read(Duration timeout);

    int fd_;
    std::string text_;
    std::size_t seen_ = 0;
};

} // namespace fraja
