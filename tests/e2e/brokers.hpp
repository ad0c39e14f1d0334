// Several brokers that stand for each other, as processes; on hosts of their own, if the test has a
// network.
#pragma once

#include "tests/e2e/farm.hpp"
#include "tests/support/network.hpp"

#include <csignal>
#include <deque>
#include <string>
#include <utility>

namespace fraja::e2e {

/// `network`: null where all are on this machine.
inline Process start_program(const std::string& name, Words words,
                             const TestNetwork* network = nullptr, std::size_t host = 0) {
    words.insert(words.begin(), program(name));
    Command command{std::move(words)};
    auto process = Process::start(network ? network->on(host, std::move(command)) : command);
    REQUIRE(process.has_value());
    return std::move(*process);
}

/// The first one is alone at first. Each other knows it, and hears of the others from it. Where
/// there is a network each is on the host of its number.
class Brokers {
public:
    explicit Brokers(std::size_t count, Words options = {}, const TestNetwork* network = nullptr)
        : options_(std::move(options)), network_(network) {
        if (network)
            options_.emplace_back("--insecure"); // nobody else is on it
        for (std::size_t i = 0; i < count; ++i)
            start(i);
        // What is submitted before they have met is kept by one alone.
        const std::string others = std::to_string(count - 1);
        for (std::size_t i = 0; i < count; ++i)
            wait_for(i, others + (count > 2 ? " other brokers of " : " other broker of ") + others);
        for (std::size_t i = 1; i < count; ++i)
            wait_for(i, "has all that the other brokers have");
    }

    /// With what it had kept before.
    void start(std::size_t i) {
        Words words{"--heartbeat", instrumented ? "2s" : "500ms", "--state",
                    scratch_.file("broker" + std::to_string(i))};
        words = with(std::move(words), options_);
        const std::string anywhere =
            "tcp://" + (network_ ? TestNetwork::address(i) : "127.0.0.1") + ":0";
        for (const char* option : {"--bind", "--publish"}) {
            words.emplace_back(option);
            words.push_back(endpoints_.size() > i ? (option[2] == 'b' ? endpoints_ : streams_)[i]
                                                  : anywhere);
        }
        if (!endpoints_.empty())
            words = with(std::move(words), {"--peer", endpoints_[i == 0 ? 1 : 0]});
        Process process = start_program("fraja-broker", words, network_, i);
        const auto line = process.wait_for_words(Process::Stream::out, "listening ", patience);
        REQUIRE(line.has_value());
        if (endpoints_.size() == i) {
            const auto stream_at = line->find(" stream ");
            endpoints_.push_back(line->substr(10, stream_at - 10));
            streams_.push_back(line->substr(stream_at + 8));
            processes_.push_back(std::move(process));
        } else {
            processes_[i] = std::move(process);
        }
    }
    void wait_for(std::size_t i, const std::string& words) {
        INFO(processes_[i].story());
        REQUIRE(processes_[i].wait_for_words(Process::Stream::err, words, patience).has_value());
    }
    void kill(std::size_t i) {
        processes_[i].send(SIGKILL);
        (void)processes_[i].wait_for_exit(patience);
    }
    [[nodiscard]] std::size_t count() const { return processes_.size(); }
    [[nodiscard]] Process& at(std::size_t i) { return processes_[i]; }
    [[nodiscard]] const std::string& endpoint(std::size_t i) const { return endpoints_[i]; }

private:
    Scratch scratch_;
    Words options_, endpoints_, streams_;
    const TestNetwork* network_;
    std::deque<Process> processes_;
};

/// Knows the first broker alone; each of them has welcomed it.
inline Process start_worker(Brokers& brokers, const std::string& name, const Words& options = {},
                            const TestNetwork* network = nullptr, std::size_t host = 0) {
    Process worker = start_program(
        "fraja-worker", with({"-b", brokers.endpoint(0), "-j", "1", "--name", name}, options),
        network, host);
    for (std::size_t i = 0; i < brokers.count(); ++i)
        brokers.wait_for(i, "worker " + name + " is here");
    return worker;
}

} // namespace fraja::e2e
