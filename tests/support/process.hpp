// Programs under test: started, listened to, signalled, and never left behind.
#pragma once

#include "common/base/instant.hpp"
#include "common/base/result.hpp"

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <sys/types.h>
#include <vector>

namespace fraja {

/// What to start: a program's path (or a name to look for in PATH), its arguments, and variables
/// ("NAME=VALUE") that are added to the test's own environment or replace them there. Settings
/// files of whoever runs the test are not read, and pictures do not tell when they were made.
struct Command {
    std::vector<std::string> argv;
    std::vector<std::string> env = {};
};

/// One running program, its standard input empty and its two outputs kept. It leads a process
/// group of its own; all of that dies with this object, or with the test's main thread.
///
/// No threads: output is read while any Process waits, of all of them, so that a talkative one
/// does not stall on a full pipe meanwhile. Use from one thread only.
class Process {
public:
    enum class Stream { out, err };

    /// Errors: io, when the system cannot run it. Aborts on an empty argv.
    [[nodiscard]] static Result<Process> start(const Command& command);
    ~Process();
    Process(Process&&) noexcept;
    Process& operator=(Process&&) noexcept;

    [[nodiscard]] pid_t pid() const;

    /// The first line of that stream, from its beginning, for which `wanted` holds; waits for one
    /// until `timeout` has passed or no more can come. `wanted` sees every complete line once and
    /// in order, without its newline; so it may count.
    [[nodiscard]] std::optional<std::string>
    wait_for_line(Stream stream, std::function<bool(std::string_view)> wanted, Duration timeout);

    /// The first line that has these words in it; else as above.
    [[nodiscard]] std::optional<std::string> wait_for_words(Stream stream, std::string_view words,
                                                            Duration timeout);

    /// The exit code, or minus the signal that ended it; nothing when it still runs after
    /// `timeout`. May be asked again. What is left of its process group is killed.
    [[nodiscard]] std::optional<int> wait_for_exit(Duration timeout);

    /// SIGTERM, SIGKILL, SIGSTOP, SIGCONT, ... to the program alone. Nothing happens once
    /// wait_for_exit() has seen its end.
    void send(int signal);

    /// What it has said so far.
    [[nodiscard]] const std::string& text(Stream stream) const;
    [[nodiscard]] const std::string& out() const { return text(Stream::out); }
    [[nodiscard]] const std::string& err() const { return text(Stream::err); }

    /// Command, state and both outputs, to be shown where a test fails: INFO(process.story()).
    [[nodiscard]] std::string story() const;

private:
    struct State;
    explicit Process(std::unique_ptr<State> state);
    std::unique_ptr<State> state_;
};

/// How a program that was run to its end came out.
struct RunResult {
    std::optional<int> exit; ///< nothing: it had to be killed when the time was up
    std::string out, err;
};

/// Starts it and waits for its end. Errors: as Process::start().
[[nodiscard]] Result<RunResult> run(const Command& command, Duration timeout);

} // namespace fraja
