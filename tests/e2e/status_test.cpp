// A broker that is watched over: its pages, its log, its state on demand.
#include "common/net/sockets.hpp"
#include "common/protocol/codec.hpp"
#include "tests/e2e/farm.hpp"
#include "tests/support/connection.hpp"
#include "tests/support/folder.hpp"
#include "tests/support/messages.hpp"

#include <cmath>
#include <csignal>
#include <filesystem>
#include <map>
#include <regex>
#include <set>
#include <sstream>

using namespace fraja;
using namespace fraja::e2e;

namespace {

/// Where the broker says that its pages are.
std::uint16_t http_port(Farm& farm) {
    const auto line = farm.broker().wait_for_line(
        Process::Stream::out, [](std::string_view l) { return l.starts_with("http "); }, patience);
    INFO(farm.broker().story());
    REQUIRE(line.has_value());
    return port_of(*line);
}

/// Every series that is served, by its name with labels.
std::map<std::string, double> series(std::uint16_t port) {
    const HttpAnswer answer = ask_http(port, "GET", "/metrics", patience);
    REQUIRE(answer.status == 200);
    std::map<std::string, double> all;
    std::istringstream lines(answer.body);
    for (std::string line; std::getline(lines, line);)
        if (!line.starts_with('#')) {
            const std::size_t blank = line.rfind(' ');
            all[line.substr(0, blank)] = std::stod(line.substr(blank + 1));
        }
    return all;
}

/// Waits until a number is as wanted. There is none of the farm before the loop's first turn.
void wait_for(std::uint16_t port, const std::string& name, double wanted) {
    const auto end = std::chrono::steady_clock::now() + patience;
    for (;;) {
        const auto all = series(port);
        const auto found = all.find(name);
        if (found != all.end() && found->second == wanted)
            return;
        CAPTURE(name);
        CAPTURE((found == all.end() ? -1 : found->second));
        REQUIRE(std::chrono::steady_clock::now() < end);
    }
}

/// What the board or the alerts ask for: names, with the labels that they give a value.
std::set<std::string> wanted_series(const std::string& text) {
    static const std::regex metric(R"(\b((?:fraja_broker|process)_[a-z_]+)(\{[^}]*\})?)");
    static const std::regex label(R"re(([a-z]+)=~?\\?"([a-z_|]+)\\?")re");
    std::set<std::string> wanted;
    for (std::sregex_iterator m(text.begin(), text.end(), metric), end; m != end; ++m) {
        wanted.insert((*m)[1]);
        const std::string labels = (*m)[2];
        for (std::sregex_iterator l(labels.begin(), labels.end(), label); l != end; ++l) {
            if ((*l)[1] == "job" || (*l)[1] == "instance")
                continue; // Prometheus's own
            std::istringstream values((*l)[2]);
            for (std::string value; std::getline(values, value, '|');)
                wanted.insert((*m)[1].str() + "{" + (*l)[1].str() + "=\"" + value + "\"}");
        }
    }
    return wanted;
}

} // namespace

TEST_CASE("metrics tell what the farm has done") {
    const Scratch scratch;
    Farm farm({"--heartbeat", heartbeat_option, "--http", "127.0.0.1:0", "--state",
               scratch.file("state")});
    const std::uint16_t port = http_port(farm);
    wait_for(port, "fraja_broker_workers{state=\"idle\"}", 0);
    farm.add_worker("one");
    wait_for(port, "fraja_broker_workers{state=\"idle\"}", 1);
    CHECK(farm.submit({scene("cone"), "-r", "40x30", "-o", scratch.file("c.png")}).exit == 0);
    wait_for(port, "fraja_broker_jobs_ended_total{outcome=\"done\"}", 1);
    const auto all = series(port);
    CHECK(all.at("fraja_broker_rays_total{kind=\"camera\"}") == 40 * 30);
    CHECK(all.at("fraja_broker_tiles_done_total") >= 1);
    CHECK(all.at("fraja_broker_received_bytes_total") > 40 * 30 * 12); // pixels of three floats
    CHECK(all.at("fraja_broker_store_commits_total") >= 1);
    CHECK(all.at("fraja_broker_store_written_bytes_total") > 40 * 30 * 12);
    CHECK(all.at("fraja_broker_store_bytes") > 40 * 30 * 12);
    CHECK(all.at("process_resident_memory_bytes") > 1e6);
    CHECK(all.at("process_open_fds") > 5);
    const double now_s = seconds(std::chrono::system_clock::now().time_since_epoch());
    CHECK(std::abs(all.at("process_start_time_seconds") - now_s) < seconds(patience));
    CHECK(ask_http(port, "GET", "/healthz", patience).status == 200);
    CHECK(farm.broker().out().find("http http://127.0.0.1:") >
          farm.broker().out().find("listening tcp://")); // what was there comes first
}

TEST_CASE("every metric that the board and the alerts ask for is served") {
    const Scratch scratch;
    Farm farm({"--http", "127.0.0.1:0", "--state", scratch.file("state")});
    const std::uint16_t port = http_port(farm);
    wait_for(port, "fraja_broker_workers{state=\"idle\"}", 0);
    std::set<std::string> served;
    for (const auto& [name, value] : series(port)) {
        served.insert(name);
        served.insert(name.substr(0, name.find('{')));
    }
    for (const char* file : {"tools/grafana/fraja.json", "tools/prometheus/alerts.yml"}) {
        CAPTURE(file);
        const auto wanted = wanted_series(bytes_of(std::string(FRAJA_SOURCE_DIR) + "/" + file));
        CHECK(wanted.size() > 10);
        for (const std::string& name : wanted) {
            CAPTURE(name);
            CHECK(served.contains(name));
        }
    }
    const auto board = nlohmann::json::parse(
        bytes_of(std::string(FRAJA_SOURCE_DIR) + "/tools/grafana/fraja.json"));
    CHECK(board.at("panels").size() > 10);
}

TEST_CASE("a broker whose disk is full says so to whoever asks for its health") {
    const Scratch scratch;
    Farm farm({"--http", "127.0.0.1:0", "--state", scratch.file("state")},
              {"env", "--ignore-signal=XFSZ", "prlimit", "--fsize=1000000:unlimited"});
    const std::uint16_t port = http_port(farm);
    wait_for(port, "fraja_broker_store_failing", 0);
    CHECK(ask_http(port, "GET", "/healthz", patience).status == 200);
    farm.add_worker("one");
    Process client =
        farm.start_submit({scene("cone"), "-r", "400x300", "-o", scratch.file("c.png")});
    wait_for(port, "fraja_broker_store_failing", 1);
    const HttpAnswer health = ask_http(port, "GET", "/healthz", patience);
    CHECK(health.status == 503);
    CHECK(contains(nlohmann::json::parse(health.body).at("reason").get<std::string>(),
                   "nothing can be kept"));
}

TEST_CASE("pages off loopback want --insecure, and a port that is taken is said to be") {
    const auto refusal = [](const Words& options, int exit = 2) {
        const auto ran = run({with({program("fraja-broker"), "--state", "none", "--bind",
                                    "tcp://127.0.0.1:0", "--publish", "tcp://127.0.0.1:0"},
                                   options)},
                             patience);
        REQUIRE(ran.has_value());
        CHECK(ran->exit == exit);
        CHECK(ran->out.empty());
        return ran->err;
    };
    CHECK(contains(refusal({"--http", "*:0"}), "can be reached from other machines"));
    CHECK(contains(refusal({"--http", "*:0", "--check"}), "can be reached from other machines"));
    CHECK(contains(refusal({"--http", "ipc:///tmp/x"}), "--http"));
    Farm farm({"--http", "127.0.0.1:0"});
    const std::string taken = "127.0.0.1:" + std::to_string(http_port(farm));
    CHECK(contains(refusal({"--http", taken}, 75), taken + ": cannot listen there: "));
}

TEST_CASE("strangers at the pages do the farm no harm") {
    const Scratch scratch;
    Farm farm({"--heartbeat", heartbeat_option, "--http", "127.0.0.1:0"});
    farm.add_worker("one");
    const std::uint16_t port = http_port(farm);
    const double before = resident_mib(farm.broker().pid());
    std::vector<Connection> slow;
    for (int i = 0; i < 100; ++i)
        slow.emplace_back(port).say("GET /metr");
    Process client = farm.start_submit({scene("cone"), "-r", "80x60", "-o", scratch.file("c.png")});
    for (int i = 0; i < 200; ++i)
        Connection(port).say(std::string(20'000, 'x'));
    CHECK(client.wait_for_exit(patience) == 0);
    if (!instrumented) // sanitizers keep freed memory
        CHECK(resident_mib(farm.broker().pid()) - before < 50);
    slow.clear();
    // Who is there is answered again, and no worker was lost meanwhile.
    int status = 0;
    for (const auto end = std::chrono::steady_clock::now() + patience;
         status != 200 && std::chrono::steady_clock::now() < end;)
        status = ask_http(port, "GET", "/healthz", patience).status;
    CHECK(status == 200);
    CHECK(series(port).at("fraja_broker_workers_lost_total") == 0);
    slow.emplace_back(port).say("GET /metr");
    farm.broker().send(SIGTERM); // it does not wait for them
    CHECK(farm.broker().wait_for_exit(patience) == 0);
}

TEST_CASE("however many say nothing at the pages, or speak slowly, nobody else waits") {
    Farm farm({"--http", "127.0.0.1:0"});
    const std::uint16_t port = http_port(farm);
    std::vector<Connection> idle, trickling;
    for (int i = 0; i < 200; ++i)
        idle.emplace_back(port);
    for (int i = 0; i < 50; ++i)
        trickling.emplace_back(port);
    for (const char byte : std::string_view("GET /healthz")) {
        for (Connection& connection : trickling)
            connection.say(std::string_view(&byte, 1)); // or it was given up
        const auto begin = std::chrono::steady_clock::now();
        CHECK(ask_http(port, "GET", "/healthz", patience).status == 200);
        CHECK(std::chrono::steady_clock::now() - begin < 4s); // a request may take 5 to come
    }
}

TEST_CASE("strangers who speak rubbish cannot flood the log") {
    Farm farm({"--http", "127.0.0.1:0", "--log-format", "json"});
    const std::uint16_t port = http_port(farm);
    const net::Context context;
    auto socket = net::DealerSocket::connect(context, farm.endpoint());
    REQUIRE(socket.has_value());
    constexpr int count = instrumented ? 2'000 : 20'000;
    for (int i = 0; i < count; ++i) {
        while (socket->send(protocol::Packet{to_bytes("FR\xff\nJA"), {}, {}}) !=
               net::SendStatus::sent)
            net::wait({*socket}, 10ms);
        while (socket->receive()) {
        }
    }
    wait_for(port, "fraja_broker_messages_refused_total{reason=\"malformed\"}", count);
    farm.broker().send(SIGTERM);
    REQUIRE(farm.broker().wait_for_exit(patience) == 0);
    int lines = 0, told = 0;
    std::istringstream log(farm.broker().err());
    for (std::string line; std::getline(log, line); ++lines) {
        const auto object = nlohmann::json::parse(line); // whatever was said
        CHECK(object.at("schema") == "fraja.log/1");
        if (object.value("event", "") == "rubbish")
            told += 1 + object.value("more", 0);
    }
    CHECK(told == count); // all is accounted for
    CHECK(lines < 50);
}

TEST_CASE("a log that is no terminal's is coloured only where that is asked for") {
    struct Row {
        Words options;
        bool coloured;
    };
    for (const Row& row :
         {Row{{}, false}, Row{{"--color", "always"}, true}, Row{{"--color", "never"}, false},
          Row{{"--color", "always", "--log-format", "json"}, false}}) {
        Farm farm(row.options);
        farm.add_worker("one");
        farm.broker().send(SIGTERM);
        REQUIRE(farm.broker().wait_for_exit(patience) == 0);
        INFO(farm.broker().story());
        CHECK(contains(farm.broker().err(), "\x1b[") == row.coloured);
    }
}

TEST_CASE("USR1 writes the state to the log, as often as it is asked for") {
    const Scratch scratch;
    Farm farm({"--http", "127.0.0.1:0"});
    farm.add_worker("one");
    const std::string id = farm.detach({scene("cone"), "-r", "20x15", "--name", "picture"});
    // What is told may be of before fraja-submit came, and its goodbye may come late.
    const std::uint16_t port = http_port(farm);
    wait_for(port, "fraja_broker_jobs_acknowledged_total", 1);
    wait_for(port, "fraja_broker_clients", 0);
    for (int i = 1; i <= 20; ++i) {
        farm.broker().send(SIGUSR1);
        int seen = 0;
        const auto worker = farm.broker().wait_for_line(
            Process::Stream::err,
            [&](std::string_view l) {
                return contains(l, "worker one ") && contains(l, " tiles in flight, ") &&
                       ++seen == i;
            },
            patience);
        INFO(farm.broker().story());
        REQUIRE(worker.has_value());
    }
    CHECK(contains(farm.broker().err(), "1 worker, 1 job, 0 clients"));
    CHECK(contains(farm.broker().err(), "job #1 picture " + id + ": "));
}

TEST_CASE("a broker that stops says what becomes of the jobs that are not over") {
    const Scratch scratch;
    struct Row {
        std::string state;
        const char* says;
    };
    for (const Row& row :
         {Row{"none", "stopping: 1 job not over, which nobody keeps (--state)"},
          Row{scratch.file("state"), "stopping: 1 job to go on with when it is started again"}}) {
        Farm farm({"--state", row.state});
        (void)farm.detach({scene("cone"), "-r", "20x15"});
        farm.broker().send(SIGTERM);
        REQUIRE(farm.broker().wait_for_exit(patience) == 0);
        INFO(farm.broker().story());
        CHECK(contains(farm.broker().err(), row.says));
    }
}

TEST_CASE(
    "a broker that is hung up on reads its settings again, and keeps what it had of bad ones") {
    const Folder folder;
    std::filesystem::create_directory(folder / "fraja");
    const auto settings = [&](const std::string& text) {
        const auto file = folder.write("fraja/config.toml", "[fraja-broker]\n" + text + "\n");
        REQUIRE(std::filesystem::exists(file));
    };
    settings("log-level = 'error'");
    auto broker = Process::start({{program("fraja-broker"), "--bind", "tcp://127.0.0.1:0",
                                   "--publish", "tcp://127.0.0.1:0", "--state", "none"},
                                  {"XDG_CONFIG_HOME=" + folder.path.string()}});
    REQUIRE(broker.has_value());
    using enum Process::Stream;
    REQUIRE(broker->wait_for_words(out, "listening", patience));
    CHECK(broker->err().empty()); // nothing as bad as an error
    settings("log-level = 'info'\nkeep = '1h'");
    broker->send(SIGHUP);
    CHECK(broker->wait_for_words(err, "read its options again", patience));
    settings("keep = 'for ever'");
    broker->send(SIGHUP);
    const auto refused = broker->wait_for_words(err, "everything stays as it was", patience);
    REQUIRE(refused.has_value());
    CHECK(refused->find("--keep for ever: a duration, as 7d") != std::string::npos);
    broker->send(SIGTERM);
    CHECK(broker->wait_for_exit(patience) == 0);
}
