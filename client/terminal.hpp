// Terminals: how large the window is, what keys are pressed, what it can show.
#pragma once

#include "client/preview/fit.hpp"

#include <cstdio>
#include <memory>
#include <optional>
#include <string_view>

namespace fraja::client {

/// Of the terminal behind `fd`; for what is none, the values of a Window.
[[nodiscard]] Window window_of(int fd);

/// While this lives, keys are read one by one from the terminal at stdin, and not shown; Ctrl-C
/// still is a signal, Ctrl-Z is not.
class RawKeys {
public:
    /// Nothing where stdin is no terminal, or another program has it at the moment.
    [[nodiscard]] static std::optional<RawKeys> take();
    ~RawKeys();
    RawKeys(RawKeys&&) noexcept;
    RawKeys& operator=(RawKeys&&) = delete;

    /// The next byte, if there is one. Never waits.
    [[nodiscard]] std::optional<char> read() const;
    /// Whether `q` was pressed since this was asked. Takes all keys there are.
    [[nodiscard]] bool has_left() const;

private:
    struct Before;
    explicit RawKeys(std::unique_ptr<Before> before);
    std::unique_ptr<Before> before_;
};

/// Whether a terminal's answer to DA1, as `ESC [ ? 62 ; 4 ; 22 c`, names sixels: the number 4, but
/// not as the first, which is what it is called.
[[nodiscard]] bool names_sixel(std::string_view answer);
/// Asks the terminal behind `fd` what it is (DA1), and waits a moment for the answer. False where
/// that is not the terminal that answers to stdin, or no answer comes.
[[nodiscard]] bool answers_sixel(int fd);

} // namespace fraja::client
