// fraja-broker: reads the options and runs the broker.
#include "broker/board.hpp"
#include "broker/restore.hpp"
#include "broker/shell.hpp"
#include "broker/status_pages.hpp"
#include "broker/store.hpp"
#include "broker/store_reader.hpp"
#include "broker/store_schema.hpp"
#include "common/base/freed_memory.hpp"
#include "common/base/text.hpp"
#include "common/base/version.hpp"
#include "common/cli/parse.hpp"
#include "common/cli/state_folder.hpp"
#include "common/discovery/announcer.hpp"
#include "common/discovery/source.hpp"
#include "common/net/descriptors.hpp"
#include "common/net/endpoint.hpp"
#include "common/protocol/limits.hpp"
#include "common/service/key_options.hpp"
#include "common/service/logger.hpp"
#include "common/service/notifier.hpp"
#include "worker/options.hpp"

#include <CLI/CLI.hpp>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fmt/core.h>
#include <optional>
#include <string>
#include <system_error>
#include <unistd.h>
#include <utility>
#include <vector>

namespace {

using namespace fraja;

constexpr const char* program = "fraja-broker";
constexpr const char* examples = R"(Examples:
  fraja-broker                                   a broker for this machine
  fraja-broker --bind tcp://127.0.0.1:0 --publish tcp://127.0.0.1:0
                                                 on ports the system chooses; they are printed
  fraja-broker --bind 'tcp://*:50057' --publish 'tcp://*:50058' --key-file broker.key --allow allow
                                                 for all who have a key in the file allow
  fraja-broker --bind 'tcp://*:50057' --publish 'tcp://*:50058' --insecure
                                                 for a network you trust
  fraja-broker --bind tcp://127.0.0.1:50067 --publish tcp://127.0.0.1:50068 --upstream tcp://root:50057
                                                 with its workers, one of the workers of root

Deals out the tiles of submitted pictures to workers and publishes them as they finish.
)";

struct Arguments {
    broker::Options options;
    std::string state;                         ///< empty: the default, where there can be one
    std::string http;                          ///< empty: no pages
    std::optional<http::Address> http_address; ///< that is
    std::string heartbeat = "1s", lease = "60s", keep = "7d", quarantine = "3/10m";
    service::LogOptions log;
    service::KeyOptions keys;
    std::string announce; ///< empty: not at all
    bool check = false;
};

int fail(const std::string& message) {
    return cli::leave(cli::failure(program, message));
}

int fail(const Error& error) {
    return cli::leave(cli::failure(program, error));
}

/// Of so many failures within a time: `3/10m`.
Result<void> read_quarantine(const std::string& text, broker::Limits& limits) {
    const std::size_t slash = text.find('/');
    const auto count = parse_count(std::string_view(text).substr(0, slash));
    const auto window =
        slash == std::string::npos ? std::nullopt : parse_duration(text.substr(slash + 1));
    if (!count || *count < 1 || *count > 1'000'000 || !window || *window <= Duration::zero())
        return Error{ErrorCode::invalid_argument,
                     "--quarantine " + text + ": failures and a time, as 3/10m"};
    limits.quarantine_failures = static_cast<std::uint32_t>(*count);
    limits.quarantine_window = *window;
    return {};
}

/// As sockets take it.
Result<void> complete_endpoint(const char* option, std::string& endpoint) {
    if (discovery::is_source(endpoint))
        return Error{ErrorCode::invalid_argument, std::string(option) + " " + endpoint +
                                                      ": no broker is looked for here; name it, "
                                                      "HOST:PORT"};
    auto whole = net::endpoint_to_connect(endpoint, net::broker_port);
    if (!whole)
        return Error{whole.error().code, std::string(option) + ": " + whole.error().message};
    endpoint = std::move(*whole);
    return {};
}

Result<void> complete_upstream(broker::Options& options) {
    broker::UpstreamOptions& upstream = options.upstream;
    if (upstream.brokers.empty())
        return {};
    const auto own = net::parse_endpoint(options.bind, net::broker_port);
    for (std::string& broker : upstream.brokers) {
        if (auto done = complete_endpoint("--upstream", broker); !done)
            return done;
        if (own && net::to_string(*own) == broker)
            return Error{ErrorCode::invalid_argument,
                         "--upstream " + broker + ": that is where this broker listens itself"};
    }
    upstream.name = worker::default_worker_name();
    worker::WorkerOptions as_worker;
    as_worker.brokers = upstream.brokers;
    as_worker.name = upstream.name;
    as_worker.tags = upstream.tags;
    return worker::validate(as_worker);
}

Result<void> complete_peers(broker::Options& options) {
    for (std::string& peer : options.peers)
        if (auto done = complete_endpoint("--peer", peer); !done)
            return done;
    if (!options.advertise.empty())
        if (auto done = complete_endpoint("--advertise", options.advertise); !done)
            return done;
    if (!options.peers.empty() && !options.upstream.brokers.empty())
        return Error{ErrorCode::invalid_argument,
                     "--peer, --upstream: brokers that stand for each other serve no other one"};
    if (options.peers.size() + 1 > protocol::brokers_max)
        return Error{ErrorCode::invalid_argument, "--peer: at most " +
                                                      std::to_string(protocol::brokers_max) +
                                                      " brokers stand for each other"};
    return {};
}

constexpr std::array announce_ways = {"both", "broadcast", "multicast"};

/// What others on the network are told. `bound` is where the broker listens.
Result<discovery::Announcement> announcement(const Arguments& arguments, const std::string& bound,
                                             const net::PublicKey* farm) {
    return discovery::announcement_of(bound, arguments.options.advertise, farm,
                                      {.broadcast = arguments.announce != "multicast",
                                       .multicast = arguments.announce != "broadcast"});
}

/// A broker that cannot be announced serves those who know its address.
void begin_to_announce(std::optional<discovery::Announcer>& announcer,
                       const discovery::Announcement& what, service::Logger& logger) {
    auto sender = discovery::BeaconSender::open(what.ways);
    if (!sender)
        return logger.log({LogLevel::error, {}, {}, "--announce: " + sender.error().message});
    announcer.emplace(*std::move(sender), what.beacon,
                      [&logger](const LogLine& line) { logger.log(line); });
    logger.log({LogLevel::info,
                {},
                {},
                "announces itself by " + discovery::to_string(what.ways) + " every second" +
                    (what.beacon.farm ? "" : ", to whoever has no keys")});
}

/// Where there is room for less than this, a farm of some size is turned away.
constexpr std::size_t connections_few = 1000;
/// Of the room for connections, taken: then people are told.
constexpr double room_taken_much = 0.9;

/// The connections that the system lets this process have.
class Room {
public:
    /// Its own limit is often below ours: then it is raised. That it stays below is a warning only
    /// where that is felt soon: few farms are as large as may be.
    Room(const broker::Limits& limits, service::Logger& logger)
        : wanted_(broker::connections_max(limits)), room_(net::reserve_connections(wanted_)),
          logger_(logger) {
        if (room_ < wanted_)
            say(room_ < connections_few ? LogLevel::warning : LogLevel::debug,
                fmt::format("there is room for {}, and {} and {} take {}",
                            counted(room_, "connection"), counted(limits.workers_max, "worker"),
                            counted(limits.clients_max, "client"), wanted_));
    }

    /// Says once that it is nearly used up.
    void look_at(const broker::Figures& figures) {
        const std::size_t taken = broker::connections_of(figures.workers(), figures.clients);
        if (room_ < wanted_ && !said_ &&
            static_cast<double>(taken) >= room_taken_much * static_cast<double>(room_)) {
            said_ = true;
            say(LogLevel::warning, fmt::format("of the room for {}, {} are taken",
                                               counted(room_, "connection"), taken));
        }
    }

private:
    void say(LogLevel level, const std::string& what) {
        logger_.log({level,
                     {},
                     {},
                     what + ": the system lets this process have no more file descriptors (raise "
                            "ulimit -Hn, or LimitNOFILE= of the service)"});
    }

    std::size_t wanted_, room_;
    service::Logger& logger_;
    bool said_ = false;
};

/// Why no file can be made in that folder, which need not be there yet. Empty: it can.
std::string why_no_folder(const std::filesystem::path& folder) {
    std::error_code ignored;
    std::filesystem::path at = std::filesystem::absolute(folder, ignored);
    while (!std::filesystem::exists(at, ignored) && at.has_relative_path())
        at = at.parent_path();
    if (!std::filesystem::is_directory(at, ignored))
        return at.string() + " is no directory";
    if (access(at.c_str(), W_OK | X_OK) != 0)
        return at.string() + ": " + std::generic_category().message(errno);
    return {};
}

/// What is in the store, for people; read to the last byte.
int check_state(const std::string& state) {
    if (state == "none") {
        fmt::print("--state none: nothing is kept\n");
        return 0;
    }
    std::error_code ignored;
    if (const auto file = std::filesystem::path(state) / broker::store_file_name;
        !std::filesystem::exists(file, ignored)) {
        if (const std::string why = why_no_folder(state); !why.empty())
            return fail("--state " + state + ": " + why);
        fmt::print("{}: there is no store yet: it will be made\n", file.string());
        return 0;
    }
    const auto store = broker::Store::open(state);
    auto reader = store ? broker::StoreReader::open(*store) : store.error();
    const auto restored = reader ? broker::restore(*store, *reader) : reader.error();
    if (!restored)
        return fail(restored.error().message);
    const broker::Contents& contents = restored->contents;
    if (const auto sound = broker::check_bytes(contents, *reader); !sound)
        return fail(sound.error().message);
    std::size_t tiles = 0, over = 0;
    for (const broker::StoredJob& job : contents.jobs) {
        tiles += job.tiles.size();
        over += is_over(job.phase);
    }
    fmt::print("{}: {}, {} of them over, {}, {}\n", store->file().string(),
               counted(contents.jobs.size(), "job"), over, counted(tiles, "tile"),
               counted(contents.blobs.size(), "scene"));
    return 0;
}

void describe(CLI::App& app, Arguments& arguments) {
    broker::Options& options = arguments.options;
    app.set_version_flag("--version", version_line(program));
    app.add_option("--bind", options.bind,
                   "Where workers and clients connect; port 0: the system chooses")
        ->envname("FRAJA_BIND")
        ->capture_default_str()
        ->type_name("ENDPOINT");
    app.add_option("--publish", options.publish, "Where the stream of tiles is published")
        ->envname("FRAJA_PUBLISH")
        ->capture_default_str()
        ->type_name("ENDPOINT");
    app.add_option(
           "--state", arguments.state,
           "Directory where jobs, scenes and finished tiles are kept, so that a broker that is "
           "started again goes on with them; none: in memory alone")
        ->envname("FRAJA_STATE")
        ->default_str("$XDG_STATE_HOME/fraja")
        ->type_name("DIR");
    service::add_key_options(app, arguments.keys,
                             "Public key of the broker that --upstream names; without it, the own "
                             "one, as of a broker of the same farm");
    app.add_option(
           "--allow", options.allow,
           "Whose keys may do what, a line each: worker (workers where many machines have it), "
           "submit, watch or admin (several as submit,admin), the public key, a name; read again "
           "at HUP")
        ->envname("FRAJA_ALLOW")
        ->type_name("FILE");
    app.add_flag("--insecure", options.insecure,
                 "Serve addresses that other machines reach, without keys");
    app.add_option(
           "--http", arguments.http,
           "Where /metrics (for Prometheus), /healthz and /livez are served; port 0: the system "
           "chooses; it is printed")
        ->envname("FRAJA_HTTP")
        ->type_name("ADDR:PORT");
    app.add_option("--heartbeat", arguments.heartbeat, "Time between two signs of life")
        ->capture_default_str()
        ->type_name("T");
    app.add_option("--liveness", options.limits.liveness, "Beats that a worker or client may miss")
        ->capture_default_str()
        ->check(CLI::Range(1, 1000))
        ->type_name("N");
    app.add_option("--lease", arguments.lease,
                   "A tile that traces no ray for so long is given to another worker")
        ->capture_default_str()
        ->type_name("T");
    app.add_option(
           "--max-attempts", options.limits.attempts_max,
           "Failures of one tile, on different workers where there are, before its job fails")
        ->capture_default_str()
        ->check(CLI::Range(1, 1000))
        ->type_name("N");
    app.add_option("--quarantine", arguments.quarantine,
                   "A worker that failed so many tiles within the time gets none for as long")
        ->capture_default_str()
        ->type_name("N/TIME");
    app.add_option("--peer", options.peers,
                   "Another broker that stands for this one, and this one for it: jobs go on as "
                   "long as one of them is there; with keys it has the same one; repeatable")
        ->envname("FRAJA_PEER")
        ->allow_extra_args(false)
        ->delimiter(',')
        ->type_name("ENDPOINT");
    app.add_option("--advertise", options.advertise,
                   "Where other brokers, workers and clients reach this one, if not where it is "
                   "bound")
        ->envname("FRAJA_ADVERTISE")
        ->type_name("ENDPOINT");
    app.add_flag("--announce{both}", arguments.announce,
                 "Tell the machines on this network every second where this broker is, for their "
                 "-b auto: by broadcast and multicast, or --announce=broadcast or multicast alone")
        ->envname("FRAJA_ANNOUNCE")
        ->check(CLI::IsMember(std::vector<std::string>(announce_ways.begin(), announce_ways.end())))
        ->type_name("WAY");
    app.add_option("--upstream", options.upstream.brokers,
                   "Another broker, tcp://HOST:PORT, that this one serves as a worker: what it "
                   "sends is split among the workers here; of several that stand for each other "
                   "one is enough, a comma list names more")
        ->delimiter(',')
        ->allow_extra_args(false)
        ->type_name("ENDPOINT");
    app.add_option("--upstream-tag", options.upstream.tags,
                   "K or K=V, which it is told; repeatable")
        ->allow_extra_args(false)
        ->needs("--upstream")
        ->type_name("K[=V]");
    app.add_option("--keep", arguments.keep, "How long jobs that are over are kept")
        ->capture_default_str()
        ->type_name("T");
    app.add_flag("--check", arguments.check, "Check the options and what is kept, and leave");
    service::add_log_options(app, arguments.log);
}

/// What was typed, and what stands elsewhere. Nothing: all is well.
std::optional<cli::EarlyExit> read_arguments(const std::vector<std::string>& words,
                                             Arguments& arguments) {
    CLI::App app(examples, program);
    describe(app, arguments);
    cli::Origins origins;
    if (auto early = cli::parse(app, words, origins))
        return early;
    const auto mistake = [&](const std::string& text) {
        return cli::usage_error(program, origins.blame(text));
    };
    broker::Options& options = arguments.options;
    const auto heartbeat = parse_duration(arguments.heartbeat),
               lease = parse_duration(arguments.lease), keep = parse_duration(arguments.keep);
    if (!heartbeat || *heartbeat < std::chrono::milliseconds(10))
        return mistake("--heartbeat " + arguments.heartbeat +
                       ": a duration of at least 10ms, as 1s");
    if (!lease || *lease < *heartbeat)
        return mistake("--lease " + arguments.lease +
                       ": a duration not below the heartbeat, as 60s");
    if (!keep)
        return mistake("--keep " + arguments.keep + ": a duration, as 7d");
    if (const auto read = read_quarantine(arguments.quarantine, options.limits); !read)
        return mistake(read.error().message);
    options.limits.keep = *keep;
    options.limits.heartbeat = *heartbeat;
    options.limits.lease = *lease;
    if (const auto read = complete_peers(options); !read)
        return mistake(read.error().message);
    if (const auto read = complete_upstream(options); !read)
        return mistake(read.error().message);
    if (!arguments.announce.empty())
        if (const auto what = announcement(arguments, options.bind, nullptr); !what)
            return mistake(what.error().message);
    if (!options.allow.empty() && arguments.keys.file.empty())
        return mistake("--allow is of no use without a key of the farm's own: --key-file FILE, as "
                       "fraja-ctl keygen makes it");
    if (!arguments.keys.file.empty() && options.allow.empty() && options.upstream.brokers.empty())
        return mistake("--key-file: who else may come in? --allow FILE says it");
    if (!arguments.http.empty()) {
        const auto address = broker::status_address(arguments.http, options.insecure);
        if (!address)
            return mistake("--http: " + address.error().message);
        arguments.http_address = *address;
    }
    if (arguments.state.empty())
        arguments.state = cli::state_folder().value_or("none").string();
    if (arguments.state != "none")
        options.state = arguments.state;
    return std::nullopt;
}

/// Brokers that stand for each other are one to their peers, so they have one key.
Result<std::optional<net::Keys>> read_keys(const Arguments& arguments) {
    auto keys = service::read_keys(arguments.keys, true);
    if (!keys || !*keys || !arguments.options.upstream.brokers.empty())
        return keys;
    if (!arguments.options.peers.empty() && (*keys)->broker != (*keys)->own.public_key)
        return Error{ErrorCode::invalid_argument,
                     "--peer: brokers that stand for each other have one key, that of --key-file; "
                     "here " +
                         std::string(arguments.keys.broker.empty() ? "that file" : "--broker-key") +
                         " names another one as the broker's"};
    (*keys)->broker = (*keys)->own.public_key; // others may come to stand for this one
    return keys;
}

/// As `systemctl status` shows it.
std::string summary(const broker::Figures& figures) {
    return fmt::format(
        "{}, {} in flight, {} with tiles to give", counted(figures.workers(), "worker"),
        counted(figures.tiles_in_flight, "tile"), counted(figures.jobs_ready, "job"));
}

/// The broker with what it owes to whoever runs it: a log, pages, and signs of life.
int run(Arguments& arguments, const std::vector<std::string>& words,
        const net::SignalWatch& signals) {
    service::Logger logger(program, arguments.log);
    service::Notifier notifier;
    broker::Board board;
    std::optional<Room> room; // once it listens
    broker::Options& options = arguments.options;
    std::optional<http::Server> pages;
    if (arguments.http_address) {
        auto bound =
            http::Server::bind(*arguments.http_address, {status_pages(board, options.state)});
        if (!bound)
            return fail(Error{bound.error().code, "--http: " + bound.error().message});
        pages = std::move(*bound);
    }
    const auto tell = [&](const std::string& text) { logger.log({LogLevel::info, {}, {}, text}); };
    auto keys = read_keys(arguments);
    if (!keys)
        return fail(keys.error().message);
    const std::optional<net::PublicKey> farm =
        *keys ? std::optional((*keys)->own.public_key) : std::nullopt;
    std::optional<discovery::Announcer> announcer;
    options.signals = &signals;
    options.on_log = [&](const LogLine& line) { logger.log(line); };
    options.on_listening = [&](const std::string& bound, const std::string& stream) {
        room.emplace(options.limits, logger);
        fmt::print("listening {} stream {}\n", bound, stream);
        if (pages) {
            pages->serve();
            fmt::print("http {}\n", to_string(pages->address()));
        }
        std::fflush(stdout);
        if (!arguments.announce.empty()) // it was one before ports were chosen
            begin_to_announce(announcer, *announcement(arguments, bound, farm ? &*farm : nullptr),
                              logger);
        if (pages)
            tell("metrics and health are shown at " + to_string(pages->address()));
        tell(options.state.empty()
                 ? "jobs are kept in memory only: they end with this process"
                 : "jobs are kept in " + options.state.string() + ", for " +
                       duration_in_words(options.limits.keep) + " after they end");
    };
    options.on_report = [&, told = std::string()](const broker::Report& report) mutable {
        board.post(report);
        room->look_at(report.figures);
        if (const std::string status = summary(report.figures); status != told)
            std::exchange(told, status).empty() ? notifier.ready(status) : notifier.status(status);
        notifier.alive(report.at);
        logger.tell_due();
    };
    options.on_hangup = [&]() -> std::optional<broker::Limits> {
        Arguments anew;
        if (const auto early = read_arguments(words, anew)) {
            logger.log({LogLevel::warning, {}, {}, "everything stays as it was: " + early->text});
            return std::nullopt;
        }
        logger.set_level(anew.log.least());
        tell(
            "read its options again: --lease, --max-attempts, --quarantine, --keep and --log-level "
            "hold from now on, others from the next start");
        return anew.options.limits;
    };
    options.on_stopping = [&] { notifier.stopping("writes down what is done"); };

    const net::Context context(*std::move(keys));
    const broker::Control control;
    const auto ran = broker::run_broker(context, options, control);
    if (!ran)
        return fail(ran.error());
    return 0;
}

} // namespace

int main(int argc, char** argv) {
    keep_all_freed_memory(); // the next picture needs as much; see give_back_interval
    const net::SignalWatch signals({SIGINT, SIGTERM, SIGHUP, SIGUSR1});
    const std::vector<std::string> words = cli::arguments_of(argc, argv);
    Arguments arguments;
    if (const auto early = read_arguments(words, arguments))
        return cli::leave(*early);
    if (arguments.check) {
        if (const auto keys = read_keys(arguments); !keys)
            return fail(keys.error().message);
        if (const auto& allow = arguments.options.allow; !allow.empty())
            if (const auto list = net::AllowList::read(allow); !list)
                return fail("--allow: " + list.error().message);
        return check_state(arguments.state);
    }
    return run(arguments, words, signals);
}
