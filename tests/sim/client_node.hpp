// Clients of a pretended farm: their real cores, and what is looked at in what they are given.
#pragma once

#include "client/core.hpp"
#include "client/session.hpp"
#include "common/protocol/cells.hpp"
#include "tests/sim/site.hpp"

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <vector>

namespace fraja::sim {

/// Runs one core after the other: a client's shell.
class CoreRunner {
public:
    /// `name` goes into the history.
    CoreRunner(Farm& farm, const Sites& sites, std::uint64_t name);
    CoreRunner(const CoreRunner&) = delete; // the network knows where it is
    CoreRunner& operator=(const CoreRunner&) = delete;

    /// After the last one has finished, but not within its last news.
    void start(std::unique_ptr<client::Core> core,
               std::function<void(const client::News&)> on_news);
    [[nodiscard]] bool is_running() const { return process_.running; }
    [[nodiscard]] Process& process() { return process_; }
    /// With the networks that they are in.
    [[nodiscard]] std::vector<Node> lines();

private:
    void step(const client::Event& event);
    void perform(std::vector<client::Action>& actions);
    /// False: it could not be sent.
    bool perform(client::Connect&& connect);
    bool perform(client::Speak&&);
    bool perform(client::Look&& look);
    bool perform(client::StopLooking&&);
    bool perform(client::OpenStream&&);
    bool perform(client::Subscribe&& subscribe);
    bool perform(client::Unsubscribe&& unsubscribe);
    bool perform(client::Send&& send);
    bool perform(client::News&& news);

    /// To one of the brokers.
    struct Way {
        Way(Site& s, Process& process) : site(s), line(process), subscriber{line, {}} {}
        Site& site;
        Line line;
        Subscriber subscriber;
    };
    void close();

    Farm& farm_;
    std::uint64_t name_;
    Process process_;
    std::vector<std::unique_ptr<Way>> ways_;
    Way* way_ = nullptr; ///< that it goes; null: none yet
    std::unique_ptr<client::Core> core_;
    std::function<void(const client::News&)> on_news_;
};

/// Submits a job and follows it to its end, also when it was cancelled meanwhile.
class ClientNode {
public:
    ClientNode(Farm& farm, const Sites& sites, std::size_t index);

    void start();
    [[nodiscard]] bool is_over() const { return over_; }
    [[nodiscard]] const JobId& job() const { return job_.job; }
    [[nodiscard]] Process& process() { return runner_.process(); }
    [[nodiscard]] std::vector<Node> lines() { return runner_.lines(); }

private:
    [[nodiscard]] client::SessionOptions session_options();
    void watch();
    void take(const client::News& news);
    void take(const protocol::TileDone& tile);
    void take(const client::TilesWithdrawn& withdrawn);
    [[nodiscard]] bool may_be_wrong() const;
    void begin_following(const protocol::JobState& state);
    void finish(const client::Outcome& outcome);
    void look_whether_whole();
    void violation(const std::string& what);

    Farm& farm_;
    const Sites& sites_;
    std::size_t index_;
    CoreRunner runner_;
    protocol::SubmitJob job_;
    bool over_ = false, watching_ = false;
    protocol::CellGrid grid_;
    std::vector<bool> have_;         ///< cells of all passes that it was given
    std::set<std::uint64_t> wrong_;  ///< whose pixels are not what they should be
    protocol::CheckCounts checks_{}; ///< as the broker says
};

} // namespace fraja::sim
