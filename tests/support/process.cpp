#include "tests/support/process.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <fcntl.h>
#include <poll.h>
#include <span>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <system_error>
#include <unistd.h>
#include <utility>

namespace fraja {
namespace {

using Clock = std::chrono::steady_clock;

/// A file descriptor with an owner.
class Fd {
public:
    Fd() = default;
    explicit Fd(int fd) : fd_(fd) {}
    ~Fd() { reset(); }
    Fd(Fd&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
    Fd& operator=(Fd&& other) noexcept {
        reset();
        fd_ = std::exchange(other.fd_, -1);
        return *this;
    }
    void reset() {
        if (fd_ >= 0)
            ::close(std::exchange(fd_, -1));
    }
    [[nodiscard]] int get() const { return fd_; }
    [[nodiscard]] bool is_open() const { return fd_ >= 0; }

private:
    int fd_ = -1;
};

struct Pipe {
    Fd read, write;
};

std::optional<Pipe> make_pipe() {
    std::array<int, 2> ends{};
    if (::pipe2(ends.data(), O_CLOEXEC) != 0)
        return std::nullopt;
    return Pipe{Fd(ends[0]), Fd(ends[1])};
}

Error system_error(const std::string& what) {
    return {ErrorCode::io, what + ": " + std::error_code(errno, std::generic_category()).message()};
}

/// Pictures that are drawn twice are to be the same files, and nobody's own settings are read.
constexpr std::array<const char*, 2> every_test = {"SOURCE_DATE_EPOCH=0",
                                                   "XDG_CONFIG_HOME=/dev/null"};

/// The test's environment with `extra` on top.
std::vector<std::string> merged_environment(std::span<const std::string> extra) {
    std::vector<std::string> all(extra.begin(), extra.end());
    const auto add = [&](std::string_view text) {
        const std::string_view name_and_sign = text.substr(0, text.find('=') + 1);
        if (std::ranges::none_of(
                all, [&](const std::string& e) { return e.starts_with(name_and_sign); }))
            all.emplace_back(text);
    };
    std::ranges::for_each(every_test, add);
    for (char** entry = environ; *entry; ++entry)
        add(*entry);
    return all;
}

std::vector<char*> pointers_to(std::vector<std::string>& texts) {
    std::vector<char*> pointers;
    for (std::string& text : texts)
        pointers.push_back(text.data());
    pointers.push_back(nullptr);
    return pointers;
}

struct ChildSide {
    char* const* argv;
    char* const* env;
    int out, err, trouble;
    pid_t parent;
};

/// What the child does between fork and exec. Only calls that are safe there. (posix_spawn has no
/// place for the first of them.)
[[noreturn]] void become(const ChildSide& side) {
    const auto give_up = [&] {
        const int reason = errno;
        [[maybe_unused]] const ssize_t n = ::write(side.trouble, &reason, sizeof reason);
        ::_exit(127);
    };
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (::getppid() != side.parent) // gone already: the signal would never come
        ::_exit(127);
    ::setpgid(0, 0);
    const int nothing = ::open("/dev/null", O_RDONLY);
    if (nothing < 0 || ::dup2(nothing, STDIN_FILENO) < 0 || ::dup2(side.out, STDOUT_FILENO) < 0 ||
        ::dup2(side.err, STDERR_FILENO) < 0)
        give_up();
    if (nothing > STDERR_FILENO)
        ::close(nothing);
    ::execvpe(side.argv[0], side.argv, side.env);
    give_up();
    ::_exit(127);
}

} // namespace

struct Process::State {
    pid_t pid = -1;
    std::string name;
    Fd pidfd;              // readable once the program has ended
    std::array<Fd, 2> fds; // by Stream; closed at their end
    std::array<std::string, 2> texts;
    std::optional<int> exit; // set once it is reaped

    State();
    ~State();
    State(const State&) = delete;
    State& operator=(const State&) = delete;

    void read_available(std::size_t stream);
    void reap();

    static std::vector<State*>& all();
    static void pump(const Fd* also, Clock::time_point deadline);
};

/// Every living process, so that one that waits can listen to the others too.
std::vector<Process::State*>& Process::State::all() {
    static std::vector<State*> states;
    return states;
}

Process::State::State() {
    all().push_back(this);
}

Process::State::~State() {
    if (pid > 0 && !exit)
        reap();
    std::erase(all(), this);
}

void Process::State::read_available(std::size_t stream) {
    std::array<char, 65536> buffer;
    while (fds[stream].is_open()) {
        const ssize_t n = ::read(fds[stream].get(), buffer.data(), buffer.size());
        if (n > 0)
            texts[stream].append(buffer.data(), static_cast<std::size_t>(n));
        else if (n < 0 && errno == EINTR)
            continue;
        else if (n < 0 && errno == EAGAIN)
            return;
        else
            fds[stream].reset();
    }
}

/// Ends the whole group and takes in what it has said. While its leader is not yet waited for, the
/// number is nobody else's.
void Process::State::reap() {
    ::kill(-pid, SIGKILL);
    ::kill(pid, SIGKILL); // should it not lead its group yet
    int status = 0;
    while (::waitpid(pid, &status, 0) < 0 && errno == EINTR)
        continue;
    exit = WIFSIGNALED(status) ? -WTERMSIG(status) : WEXITSTATUS(status);
    for (std::size_t stream = 0; stream < 2; ++stream)
        read_available(stream);
}

/// Waits until any process says something, and reads it; or until `also` is readable, if given; or
/// until the deadline.
void Process::State::pump(const Fd* also, Clock::time_point deadline) {
    struct Source {
        State* state;
        std::size_t stream;
    };
    std::vector<pollfd> polls = {{also ? also->get() : -1, POLLIN, 0}};
    std::vector<Source> sources = {{nullptr, 0}};
    for (State* state : all())
        for (std::size_t stream = 0; stream < 2; ++stream)
            if (state->fds[stream].is_open()) {
                polls.push_back({state->fds[stream].get(), POLLIN, 0});
                sources.push_back({state, stream});
            }
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - Clock::now());
    const auto wait_ms = std::clamp<std::int64_t>(left.count(), 0, 3'600'000);
    if (::poll(polls.data(), polls.size(), static_cast<int>(wait_ms)) <= 0)
        return;
    for (std::size_t i = 1; i < polls.size(); ++i)
        if (polls[i].revents != 0)
            sources[i].state->read_available(sources[i].stream);
}

Process::Process(std::unique_ptr<State> state) : state_(std::move(state)) {}
Process::~Process() = default;
Process::Process(Process&&) noexcept = default;
Process& Process::operator=(Process&&) noexcept = default;

Result<Process> Process::start(const Command& command) {
    FRAJA_ASSERT(!command.argv.empty());
    auto out = make_pipe(), err = make_pipe(), trouble = make_pipe();
    if (!out || !err || !trouble)
        return system_error("pipe");

    std::vector<std::string> args = command.argv, env = merged_environment(command.env);
    const std::vector<char*> argv = pointers_to(args), envp = pointers_to(env);
    const ChildSide side{argv.data(),      envp.data(),          out->write.get(),
                         err->write.get(), trouble->write.get(), ::getpid()};
    auto state = std::make_unique<State>();
    state->name = command.argv.front();
    state->pid = ::fork();
    if (state->pid == 0)
        become(side);
    if (state->pid < 0)
        return system_error("fork");
    out->write.reset(), err->write.reset(), trouble->write.reset();

    // The pipe of trouble closes at the exec, or brings the reason why there was none.
    int reason = 0;
    ssize_t n = 0;
    while ((n = ::read(trouble->read.get(), &reason, sizeof reason)) < 0 && errno == EINTR)
        continue;
    if (n == sizeof reason) {
        errno = reason;
        return system_error(command.argv.front());
    }
    // By number: the header of glibc 2.36 forgets to say extern "C".
    state->pidfd = Fd(static_cast<int>(::syscall(SYS_pidfd_open, state->pid, 0)));
    if (!state->pidfd.is_open())
        return system_error("pidfd_open");
    state->fds = {std::move(out->read), std::move(err->read)};
    for (const Fd& fd : state->fds) {
        ::fcntl(fd.get(), F_SETFL, O_NONBLOCK);
        ::fcntl(fd.get(), F_SETPIPE_SZ, 1 << 20); // room while the test is busy elsewhere
    }
    return Process(std::move(state));
}

pid_t Process::pid() const {
    return state_->pid;
}

std::optional<std::string> Process::wait_for_line(Stream stream,
                                                  std::function<bool(std::string_view)> wanted,
                                                  Duration timeout) {
    const auto deadline = Clock::now() + timeout;
    const auto index = static_cast<std::size_t>(stream);
    const std::string& text = state_->texts[index];
    std::size_t seen = 0;
    while (true) {
        for (std::size_t end; (end = text.find('\n', seen)) != std::string::npos; seen = end + 1)
            if (const std::string line = text.substr(seen, end - seen); wanted(line))
                return line;
        if (!state_->fds[index].is_open() || state_->exit || Clock::now() >= deadline)
            return std::nullopt;
        State::pump(nullptr, deadline);
    }
}

std::optional<std::string> Process::wait_for_words(Stream stream, std::string_view words,
                                                   Duration timeout) {
    return wait_for_line(
        stream, [words](std::string_view line) { return line.find(words) != line.npos; }, timeout);
}

std::optional<int> Process::wait_for_exit(Duration timeout) {
    const auto deadline = Clock::now() + timeout;
    while (!state_->exit) {
        pollfd ended{state_->pidfd.get(), POLLIN, 0};
        if (::poll(&ended, 1, 0) > 0)
            state_->reap();
        else if (Clock::now() >= deadline)
            return std::nullopt;
        else
            State::pump(&state_->pidfd, deadline);
    }
    return state_->exit;
}

void Process::send(int signal) {
    if (!state_->exit)
        ::kill(state_->pid, signal);
}

const std::string& Process::text(Stream stream) const {
    return state_->texts[static_cast<std::size_t>(stream)];
}

std::string Process::story() const {
    std::string story = state_->name + " (process " + std::to_string(pid()) + ") ";
    story += state_->exit ? "ended with " + std::to_string(*state_->exit) : "is running";
    story += "\n-- stdout\n" + out() + "\n-- stderr\n" + err();
    return story;
}

Result<RunResult> run(const Command& command, Duration timeout) {
    auto process = Process::start(command);
    if (!process)
        return process.error();
    const auto exit = process->wait_for_exit(timeout);
    if (!exit) {
        process->send(SIGKILL);
        static_cast<void>(process->wait_for_exit(timeout));
    }
    return RunResult{exit, process->out(), process->err()};
}

} // namespace fraja
