// Session: the client's end of a session with one of several brokers. Says hello until it is
// welcome, beats, notices silence, and finds back after a broker's restart. A broker that was given
// up more than once may have been slow, not gone: so that all who ask it anew do not keep it so, it
// is given longer each time.
#pragma once

#include "client/core.hpp"

#include <map>
#include <optional>
#include <string>
#include <vector>

namespace fraja::client {

struct SessionOptions {
    /// At least one; tried in turn. A source (common/discovery) stands for those that are found
    /// when it has its turn.
    std::vector<std::string> brokers;
    Duration connect_timeout = std::chrono::seconds(10);
    std::string client_name;
    bool has_keys = false; ///< so brokers show theirs
    /// The broker is of this process: it cannot be lost, however long the machine keeps it from
    /// its turn.
    bool is_in_process = false;
};

class Session {
public:
    explicit Session(SessionOptions options);

    void start(Instant now, std::vector<Action>& actions);

    enum class Change {
        none,
        heeded,  ///< it was a word to the session alone
        opened,  ///< welcome: whatever was asked on an earlier session must be asked again
        refused, ///< over, see `failure()`
        gave_up, ///< over, see `failure()`
    };
    /// Takes every event of the program, so that any traffic counts as life.
    [[nodiscard]] Change step(Instant now, const Event& event, std::vector<Action>& actions);
    [[nodiscard]] Instant next_deadline() const;

    [[nodiscard]] bool is_open() const { return open_; }
    [[nodiscard]] const protocol::Welcome& welcome() const { return welcome_; } ///< the last one
    /// The version in which the broker is spoken to now.
    [[nodiscard]] protocol::Version spoken() const { return spoken_; }
    /// Or the source that is looked at.
    [[nodiscard]] const std::string& broker() const { return brokers_[broker_]; }
    [[nodiscard]] Outcome failure() const { return failure_; }

    /// Whether a lost broker is looked for without end: when there is a job that goes on meanwhile.
    void set_patient(bool patient) { patient_ = patient; }

private:
    void look_for_broker(Instant now, std::vector<Action>& actions);
    void say_hello(Instant now, std::vector<Action>& actions,
                   protocol::Version spoken = protocol::version);
    void speak(protocol::Version spoken, std::vector<Action>& actions);
    Change heed_older_version(Instant now, protocol::Version theirs, std::vector<Action>& actions);
    Change take(Instant now, const protocol::Welcome& welcome, std::vector<Action>& actions);
    Change take(Instant now, const protocol::Refused& refused, std::vector<Action>& actions);
    Change take_refusal(Instant now, const std::string& reason, std::vector<Action>& actions);
    void learn(const std::vector<protocol::Member>& brokers);
    void take(Instant now, const BrokersFound& found, std::vector<Action>& actions);
    void list_brokers();
    void next_turn(Instant now, std::vector<Action>& actions);
    void look_at_source(Instant now, std::vector<Action>& actions);
    Change give_up();
    void lose(Instant now, std::vector<Action>& actions);
    Change tick(Instant now, std::vector<Action>& actions);
    Change end(Change change, Outcome outcome);
    [[nodiscard]] Duration turn() const;
    [[nodiscard]] Instant silent_by(Instant heard) const;
    [[nodiscard]] bool is_at_source() const;
    [[nodiscard]] bool has_sources() const;
    [[nodiscard]] bool is_unproven() const;

    const SessionOptions options_;
    std::map<std::string, std::vector<std::string>> found_; ///< by source, the last time
    std::vector<std::string> told_;                         ///< that stand for one we speak to
    std::vector<std::string> brokers_; ///< all these: those given, what was found behind its source
    std::size_t broker_ = 0;           ///< index of the one we speak to
    std::size_t refusals_ = 0;         ///< of brokers that do not let us in, since one has
    std::string refusal_;              ///< of the last of these
    std::string trouble_;              ///< of the source that was looked at last
    bool open_ = false;
    bool ended_ = false;
    bool patient_ = false;
    bool known_lost_ = false; ///< and said so
    int losses_ = 0;          ///< of late: each doubles the silence that the next one takes
    Instant opened_at_{};
    protocol::Version spoken_ = protocol::version;
    protocol::Welcome welcome_;
    Outcome failure_;

    Duration heartbeat_{}, silence_max_{};
    Instant looking_since_{}; ///< while not open
    Instant turn_ends_ = Instant::never();
    Instant look_due_ = Instant::never();      ///< at a source
    std::map<std::string, Instant> looked_at_; ///< by source
    Instant hello_due_ = Instant::never();
    Duration hello_pause_{};
    Instant beat_due_ = Instant::never();
    Instant silent_at_ = Instant::never();
};

} // namespace fraja::client
