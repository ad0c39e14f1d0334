#include "tests/support/process.hpp"

#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <doctest/doctest.h>

using namespace fraja;
using namespace std::chrono_literals;
using Stream = Process::Stream;

namespace {

constexpr Duration soon = 20s; // passes at once, unless something is wrong

Command shell(std::string script) {
    return {{"/bin/sh", "-c", std::move(script)}};
}

auto is(std::string_view want) {
    return [want](std::string_view line) { return line == want; };
}

bool alive(pid_t pid) {
    return ::kill(pid, 0) == 0 || errno != ESRCH;
}

} // namespace

TEST_CASE("run keeps both outputs apart and tells the exit code") {
    const auto result = run(shell("echo to out; echo to err >&2; exit 3"), soon);
    REQUIRE(result);
    CHECK(result->exit == 3);
    CHECK(result->out == "to out\n");
    CHECK(result->err == "to err\n");
}

TEST_CASE("run kills what does not end in time") {
    const auto result = run(shell("echo begun; sleep 600"), 50ms);
    REQUIRE(result);
    CHECK_FALSE(result->exit.has_value());
}

TEST_CASE("standard input is empty") {
    const auto result = run({{"cat"}}, soon);
    REQUIRE(result);
    CHECK(result->exit == 0);
}

TEST_CASE("the environment is the test's own with the extras on top") {
    ::setenv("FRAJA_TEST_KEPT", "kept", 1);
    ::setenv("FRAJA_TEST_REPLACED", "old", 1);
    Command command = shell("echo $FRAJA_TEST_KEPT $FRAJA_TEST_REPLACED $FRAJA_TEST_ADDED");
    command.env = {"FRAJA_TEST_REPLACED=new", "FRAJA_TEST_ADDED=added"};
    const auto result = run(command, soon);
    REQUIRE(result);
    CHECK(result->out == "kept new added\n");
}

TEST_CASE("a program that is not there is an error with a reason") {
    const auto process = Process::start({{"/no/such/program"}});
    REQUIRE_FALSE(process);
    CHECK(process.error().code == ErrorCode::io);
    CHECK(process.error().message == "/no/such/program: No such file or directory");
}

TEST_CASE("wait_for_line finds lines past and to come and sees the end of them") {
    auto process = Process::start(shell("echo one; echo two; echo three >&2; printf unfinished"));
    REQUIRE(process);
    CHECK(process->wait_for_line(Stream::out, is("two"), soon) == "two");
    CHECK(process->wait_for_line(Stream::out, is("one"), soon) == "one");
    CHECK(process->wait_for_line(Stream::err, is("three"), soon) == "three");
    int count = 0;
    CHECK(process->wait_for_line(
              Stream::out, [&](auto) { return ++count == 2; }, soon) == "two");
    CHECK_FALSE(process->wait_for_line(Stream::out, is("four"), soon).has_value());
    CHECK(process->wait_for_words(Stream::err, "hre", soon) == "three");
    CHECK_FALSE(process->wait_for_words(Stream::out, "unfinished", soon).has_value()); // no line
    CHECK(process->wait_for_exit(soon) == 0);
    CHECK(process->out() == "one\ntwo\nunfinished");
}

TEST_CASE("wait_for_line gives up at its deadline") {
    auto process = Process::start(shell("echo one; sleep 600"));
    REQUIRE(process);
    CHECK_FALSE(process->wait_for_line(Stream::out, is("two"), 50ms).has_value());
    CHECK(process->out() == "one\n");
}

TEST_CASE("a trapped signal is the program's affair and another ends it") {
    auto process = Process::start(
        shell("trap 'echo caught; exit 7' TERM; echo ready; while :; do sleep 0.01; done"));
    REQUIRE(process);
    REQUIRE(process->wait_for_line(Stream::out, is("ready"), soon));
    process->send(SIGTERM);
    CHECK(process->wait_for_exit(soon) == 7);
    CHECK(process->out() == "ready\ncaught\n");
    process->send(SIGTERM); // to nobody

    auto other = Process::start(shell("echo ready; sleep 600"));
    REQUIRE(other);
    REQUIRE(other->wait_for_line(Stream::out, is("ready"), soon));
    other->send(SIGKILL);
    CHECK(other->wait_for_exit(soon) == -SIGKILL);
}

TEST_CASE("a stopped program says nothing until it goes on") {
    auto process = Process::start(shell("while :; do echo tick; sleep 0.01; done"));
    REQUIRE(process);
    REQUIRE(process->wait_for_line(Stream::out, is("tick"), soon));
    process->send(SIGSTOP);
    // Whatever was under way arrives; then there is silence.
    CHECK_FALSE(process->wait_for_line(Stream::out, is("never"), 100ms).has_value());
    const std::size_t before = process->out().size();
    CHECK_FALSE(process->wait_for_line(Stream::out, is("never"), 100ms).has_value());
    CHECK(process->out().size() == before);
    process->send(SIGCONT);
    std::size_t bytes = 0;
    CHECK(process->wait_for_line(
        Stream::out, [&](auto line) { return (bytes += line.size() + 1) > before; }, soon));
}

TEST_CASE("nothing is left behind, not even a grandchild") {
    pid_t child = 0, grandchild = 0;
    {
        auto process = Process::start(shell("trap '' TERM; sleep 600 & echo $!; wait"));
        REQUIRE(process);
        const auto line = process->wait_for_line(
            Stream::out, [](auto) { return true; }, soon);
        REQUIRE(line);
        child = process->pid();
        grandchild = static_cast<pid_t>(std::stol(*line));
        CHECK(alive(child));
        CHECK(alive(grandchild));
    }
    CHECK_FALSE(alive(child));
    // The orphan is init's to bury: until then it is there, but dead, which a shell can tell.
    const std::string state = "/proc/" + std::to_string(grandchild) + "/stat";
    const auto gone = run(
        shell("while [ -e " + state + " ] && ! grep -q ') Z' " + state + "; do sleep 0.01; done"),
        soon);
    REQUIRE(gone);
    CHECK(gone->exit == 0);
}

TEST_CASE("a talkative program does not stall while the test waits for another") {
    auto talker = Process::start(
        shell("i=0; while [ $i -lt 300 ]; do printf '%10000d\\n' $i; i=$((i+1)); done"));
    auto other = Process::start(shell("sleep 0.2; echo done"));
    REQUIRE(talker);
    REQUIRE(other);
    CHECK(other->wait_for_line(Stream::out, is("done"), soon) == "done");
    CHECK(talker->wait_for_exit(soon) == 0);
    CHECK(talker->out().size() == 300 * 10'001);
}

TEST_CASE("a process can be moved and its story be told") {
    auto started = Process::start(shell("echo hello; exit 4"));
    REQUIRE(started);
    Process process = *std::move(started);
    CHECK(process.wait_for_exit(soon) == 4);
    CHECK(process.story().find("ended with 4\n-- stdout\nhello\n") != std::string::npos);
}
