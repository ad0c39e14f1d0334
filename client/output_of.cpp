#include "client/output_of.hpp"

#include "common/base/assert.hpp"
#include "common/net/clock.hpp"

#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

namespace fraja::client {
namespace {

/// Until its end, or nothing when the time is up.
std::optional<std::string> read_to_end(int fd, Instant end) {
    std::string text;
    for (;;) {
        const auto left = std::chrono::ceil<std::chrono::milliseconds>(end - net::now()).count();
        pollfd entry{fd, POLLIN, 0};
        if (left <= 0)
            return std::nullopt;
        if (::poll(&entry, 1, static_cast<int>(left)) != 1)
            continue;
        std::array<char, 4096> part{};
        const ssize_t count = ::read(fd, part.data(), part.size());
        if (count == 0)
            return text;
        if (count > 0 && text.size() < output_bytes_max)
            text.append(part.data(), static_cast<std::size_t>(count));
    }
}

} // namespace

std::optional<std::string> output_of(std::vector<std::string> argv, Duration timeout) {
    FRAJA_ASSERT(!argv.empty());
    std::array<int, 2> pipe{};
    if (pipe2(pipe.data(), O_CLOEXEC) != 0)
        return std::nullopt;
    std::vector<char*> words;
    for (std::string& word : argv)
        words.push_back(word.data());
    words.push_back(nullptr);
    posix_spawn_file_actions_t files;
    posix_spawn_file_actions_init(&files);
    posix_spawn_file_actions_addopen(&files, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_adddup2(&files, pipe[1], STDOUT_FILENO);
    pid_t pid = 0;
    const bool runs = posix_spawn(&pid, words[0], &files, nullptr, words.data(), environ) == 0;
    posix_spawn_file_actions_destroy(&files);
    close(pipe[1]);
    std::optional<std::string> text;
    if (runs) {
        text = read_to_end(pipe[0], net::now() + timeout);
        if (!text)
            kill(pid, SIGKILL);
        while (waitpid(pid, nullptr, 0) < 0 && errno == EINTR) {
        }
    }
    close(pipe[0]);
    return text;
}

} // namespace fraja::client
