#include "client/doctor.hpp"

#include "client/columns.hpp"
#include "client/output_of.hpp"
#include "client/shell.hpp"
#include "client/table.hpp"
#include "client/watching.hpp"
#include "common/base/allowance.hpp"
#include "common/base/text.hpp"
#include "common/base/version.hpp"
#include "common/cli/settings.hpp"
#include "common/cli/settings_file.hpp"
#include "common/cli/state_folder.hpp"
#include "common/discovery/beacon.hpp"
#include "common/discovery/source.hpp"
#include "common/image_io/picture_codec.hpp"
#include "common/net/clock.hpp"
#include "common/net/endpoint.hpp"
#include "common/net/reach.hpp"
#include "common/render/kernel/render.hpp"

#include <algorithm>
#include <filesystem>
#include <fmt/core.h>
#include <optional>
#include <set>
#include <sys/resource.h>
#include <system_error>
#include <unistd.h>
#include <utility>

namespace fraja::client {
namespace {

using namespace std::chrono_literals;
namespace fs = std::filesystem;
using enum Finding::Grade;

/// For what answers within a millisecond where it answers at all.
constexpr Duration patience = 3s;

/// What each program that is installed beside this one says of the settings files: its options are
/// known to itself alone.
std::set<std::string> mistakes_in_settings() {
    std::set<std::string> mistakes; // of what is for all of them each says the same
    std::error_code error;
    const fs::path folder = fs::read_symlink("/proc/self/exe", error).parent_path();
    for (const std::string_view program : cli::programs)
        if (const fs::path path = folder / program; fs::exists(path, error))
            if (const auto said = output_of({path.string(), "--check-settings"}, patience))
                if (const std::string line = said->substr(0, said->find('\n')); !line.empty())
                    mistakes.insert(line);
    return mistakes;
}

/// `refused_over`: as Examine has it.
std::vector<Finding> examine_settings(const std::string& refused_over) {
    std::vector<Finding> findings;
    auto mistakes = mistakes_in_settings();
    const bool known = std::ranges::any_of(mistakes, [&](const std::string& mistake) {
        return refused_over.find(mistake) != std::string::npos;
    });
    if (!refused_over.empty() && !known)
        mistakes.insert(refused_over);
    for (const std::string& mistake : mistakes)
        findings.push_back({bad, "settings", mistake,
                            "correct it there, or take it out: until then the program that it is "
                            "for does not start"});
    std::string read;
    std::error_code ignored;
    for (const fs::path& file : cli::settings_files())
        if (fs::exists(file, ignored))
            read += (read.empty() ? "" : ", ") + file.string();
    if (findings.empty())
        findings.push_back(
            {good, "settings", read.empty() ? "no settings file" : "read from " + read, {}});
    return findings;
}

Finding examine_processors() {
    const auto isa = kernel::instruction_set();
    if (!isa)
        return {bad, "processors", isa.error().message, "choose another machine, or FRAJA_ISA"};
    const Processors all = usable_processors();
    return {good,
            "processors",
            fmt::format("{} of them, {}{}", all.usable, *isa,
                        all.limit.empty() ? "" : ": " + all.limit),
            {}};
}

Finding examine_descriptors() {
    rlimit limit{};
    getrlimit(RLIMIT_NOFILE, &limit);
    const std::string text =
        limit.rlim_max == RLIM_INFINITY
            ? "as many file descriptors as wanted"
            : fmt::format("at most {} file descriptors", std::uint64_t{limit.rlim_max});
    if (limit.rlim_max < descriptors_few)
        return {doubtful, "limits", text + ": a broker here can serve few workers",
                "raise it: ulimit -Hn, or LimitNOFILE= of the service"};
    return {good, "limits", text, {}};
}

Finding examine_pictures() {
    if (const auto codec = picture_codec(); !codec)
        return {bad, "pictures", codec.error().message,
                "install libopenimageio, and keep lib/fraja beside the programs"};
    return {good, "pictures", "can be read and written", {}};
}

Finding examine_folder(const std::string& subject, fs::path folder) {
    std::error_code ec;
    while (!fs::exists(folder, ec) && folder.has_relative_path())
        folder = folder.parent_path(); // the nearest that is there: it would be made below
    const fs::space_info space = fs::space(folder, ec);
    if (ec)
        return {bad, subject, folder.string() + ": " + ec.message(), "choose another folder"};
    const std::string text = fmt::format("{} has {}B free", folder.string(),
                                         format_count(std::uint64_t{space.available}));
    if (access(folder.c_str(), W_OK) != 0)
        return {doubtful, subject, folder.string() + " cannot be written to by this user",
                subject == "state" ? "give the broker another one: --state DIR"
                                   : "write pictures elsewhere: -o FILE"};
    if (space.available < disk_bytes_few)
        return {doubtful, subject, text, "make room before a long job"};
    return {good, subject, text, {}};
}

/// The first state of the farm, and how far one came towards it.
class FarmPatient final : public Listener {
public:
    void hear(Instant now, const News& news) override {
        if (const auto* changed = std::get_if<FarmChanged>(&news); changed && !farm)
            farm = changed->farm;
        else if (const auto* connection = std::get_if<ConnectionChanged>(&news);
                 connection && connection->connected) {
            stream = connection->stream;
            give_up_at_ = now + patience;
        }
    }
    Instant tick(Instant now) override {
        gave_up_ = now >= give_up_at_;
        return give_up_at_;
    }
    std::optional<Outcome> wants_to_leave() override {
        return farm || gave_up_ ? std::optional(Outcome{}) : std::nullopt;
    }
    std::optional<protocol::FarmState> farm;
    std::string stream; ///< empty: the broker did not answer

private:
    Instant give_up_at_ = Instant::never();
    bool gave_up_ = false;
};

Finding examine_way(const std::string& broker, const net::Endpoint& endpoint) {
    const auto took = net::reach(endpoint.host, endpoint.port);
    if (took)
        return {good, broker, fmt::format("reached in {:.1f} ms", 1000 * seconds(*took)), {}};
    if (took.error().code == ErrorCode::not_found)
        return {bad, broker, took.error().message, "look for a typing error; ping " + endpoint.host,
                true};
    const bool here = net::is_loopback(endpoint);
    return {bad, broker, took.error().message,
            here ? "start one: fraja-broker" +
                       std::string(endpoint.port == net::broker_port ? "" : " --bind " + broker)
                 : "is fraja-broker running there, with --bind tcp://*:" +
                       std::to_string(endpoint.port) +
                       " and keys (or --insecure)? does a firewall close the port?",
            true};
}

/// What is told of one broker, and which one that is.
struct BrokerExamined {
    std::vector<Finding> findings;
    Outcome outcome; ///< as BrokersExamined has it
    std::optional<BrokerId> broker;
};

/// How far the conversation came says what is wrong.
std::vector<Finding> findings_of(const std::string& broker, const SharedOptions& shared,
                                 const FarmPatient& patient, const Outcome& outcome) {
    std::vector<Finding> findings;
    if (!patient.stream.empty() && shared.keys)
        findings.push_back(
            {good, "keys", "ours is known to the broker, and the broker's is ours", {}});
    const bool is_key = outcome.reason.find("version") == std::string::npos;
    if (outcome.code == ExitCode::refused && is_key)
        findings.push_back(
            {bad, "keys", outcome.reason, "SECURITY.md: how keys are made and given out"});
    else if (outcome.code == ExitCode::refused)
        findings.push_back(
            {bad, "version", outcome.reason,
             "this is " + version_line("fraja-ctl") + ": bring both to the same release"});
    else if (patient.stream.empty())
        findings.push_back({bad, broker,
                            "something listens there, and does not answer as a "
                            "fraja-broker does",
                            "look which port the broker printed when it started", true});
    else if (!patient.farm)
        findings.push_back({bad, "stream",
                            "the broker answers, and its stream at " + patient.stream + " does not",
                            "let its port through the firewall, too (--publish)"});
    else
        std::ranges::move(
            examine_farm(*patient.farm, std::chrono::system_clock::now().time_since_epoch()),
            std::back_inserter(findings));
    return findings;
}

bool is_ended(const Outcome& outcome) {
    return outcome.code == ExitCode::interrupted || outcome.code == ExitCode::terminated;
}

BrokerExamined examine_broker(const std::string& broker, const SharedOptions& shared,
                              const net::SignalWatch* signals) {
    BrokerExamined examined;
    if (const auto endpoint = net::parse_endpoint(broker, net::broker_port);
        endpoint && endpoint->transport == net::Endpoint::Transport::tcp) {
        examined.findings.push_back(examine_way(broker, *endpoint));
        if (examined.findings.back().grade == bad)
            return examined;
        if (!shared.keys && !net::is_loopback(*endpoint))
            examined.findings.push_back(
                {doubtful, "keys", "none are used here: whoever reaches the broker may use it",
                 "only on a network that you trust; --key-file, fraja-ctl keygen"});
    }
    const net::Context context(shared.keys);
    FarmPatient patient;
    SessionOptions session = session_options(shared);
    session.brokers = {broker};
    session.connect_timeout = std::min(shared.connect_timeout, patience);
    FarmWatching watching(std::move(session));
    const Outcome outcome = converse(context, watching, patient, signals);
    if (is_ended(outcome)) {
        examined.outcome = outcome;
        return examined;
    }
    if (patient.farm)
        examined.broker = patient.farm->broker.broker;
    std::ranges::move(findings_of(broker, shared, patient, outcome),
                      std::back_inserter(examined.findings));
    return examined;
}

Finding examine_source(const discovery::Findings& found) {
    if (!found.endpoints.empty())
        return {good, found.source, "names " + comma_list(found.endpoints), {}};
    if (found.source == discovery::beacon_source)
        return {bad, found.source, found.trouble,
                "let UDP port " + std::to_string(discovery::beacon_port) +
                    " through this machine's firewall; switches may keep multicast or broadcast "
                    "back; or name the broker, -b HOST",
                true};
    return {bad, found.source, found.trouble,
            "SRV records of that name, with the brokers' hosts and ports; or name one, -b HOST",
            true};
}

const char* const same_release = "bring all machines to the same release";

/// Workers of another release than the broker's: their pixels need not be those of the others.
Finding examine_releases(const protocol::FarmState& farm) {
    const protocol::WorkerState* first = nullptr;
    std::size_t others = 0;
    for (const protocol::WorkerState& worker : farm.workers)
        if (worker.program_version != farm.broker.program_version && others++ == 0)
            first = &worker;
    if (first == nullptr)
        return {};
    std::string who = "worker " + shortened(first->worker_name, 40);
    if (others > 1)
        who += fmt::format(" and {}", counted(others - 1, "other"));
    return {doubtful, "versions",
            fmt::format("{} {} not of the broker's {}: {}", who, others > 1 ? "are" : "is",
                        printable(farm.broker.program_version), printable(first->program_version)),
            same_release};
}

/// Of the brokers that stand for each other. Nothing where there is but one.
std::optional<Finding> examine_company(const protocol::FarmState& farm) {
    if (farm.brokers.size() < 2)
        return std::nullopt;
    std::size_t here = 0, keepers = 0;
    std::string leader, missing, fetching;
    const auto append = [](std::string& list, const std::string& words) {
        list += (list.empty() ? "" : ", ") + words;
    };
    for (const protocol::PeerState& peer : farm.brokers) {
        const std::string who =
            shortened(peer.endpoint.empty() ? fraja::to_string(peer.broker) : peer.endpoint, 60);
        here += peer.is_here ? 1 : 0;
        keepers += peer.is_here && peer.is_synced ? 1 : 0;
        if (peer.is_here && peer.leads)
            leader = who;
        if (!peer.is_here)
            append(missing,
                   who + (peer.broker == BrokerId{} ? " was not heard of yet" : " is gone"));
        else if (!peer.is_synced)
            append(fetching, who + " fetches what the others have");
    }
    const std::size_t all = farm.brokers.size();
    std::string text = here == all ? fmt::format("all {} are here", all)
                                   : fmt::format("{} of {} are here: {}", here, all, missing);
    if (!fetching.empty())
        text += "; " + fetching;
    if (keepers < all)
        text += fmt::format("; jobs are kept by {} of {}", keepers, all);
    text += "; " + (leader.empty() ? "none leads" : leader + " leads");
    if (here < all)
        return Finding{doubtful, "brokers", text,
                       "start what is gone again; what is gone for good is forgotten in ten "
                       "minutes, but by those that name it by --peer: start these anew without it, "
                       "one after the other"};
    if (keepers < all || leader.empty())
        return Finding{doubtful, "brokers", text, "a matter of seconds; else their logs say more"};
    return Finding{good, "brokers", text, {}};
}

/// Where it has been looked at already: no more than that it is the same.
void keep_way_alone(const std::string& broker, std::vector<Finding>& findings) {
    if (findings.front().subject == broker)
        findings = {{good, broker, findings.front().text + ": the same broker", {}}};
    else
        findings = {{good, broker, "the same broker", {}}};
}

} // namespace

std::vector<Finding> examine_machine(const std::string& refused_over) {
    std::error_code ignored;
    std::vector<Finding> findings = examine_settings(refused_over);
    for (Finding& finding :
         std::vector{examine_processors(), examine_descriptors(), examine_pictures(),
                     examine_folder("folder", fs::current_path(ignored)),
                     examine_folder("state", cli::state_folder().value_or("/"))})
        findings.push_back(std::move(finding));
    return findings;
}

std::vector<Finding> examine_farm(const protocol::FarmState& farm, Duration unix_time) {
    const protocol::BrokerState& broker = farm.broker;
    std::vector<Finding> findings;
    const std::string theirs = printable(broker.program_version);
    if (theirs == version)
        findings.push_back({good, "version", theirs + ", as here", {}});
    else
        findings.push_back(
            {doubtful, "version",
             "the broker's is " + theirs + ", and here it is " + std::string(version),
             same_release});
    if (Finding finding = examine_releases(farm); !finding.text.empty())
        findings.push_back(std::move(finding));
    if (auto finding = examine_company(farm))
        findings.push_back(*std::move(finding));
    const Duration skew = unix_time - broker.unix_time;
    const bool ahead = skew > Duration::zero();
    const std::string apart = format_duration(ahead ? skew : -skew);
    if (skew <= clock_skew_max && -skew <= clock_skew_max)
        findings.push_back({good, "clocks", "the broker's agrees with this one", {}});
    else
        findings.push_back(
            {doubtful, "clocks",
             "this machine's is " + apart + (ahead ? " ahead of" : " behind") + " the broker's",
             "let both follow a time server (chrony, systemd-timesyncd)"});
    if (!broker.trouble.empty())
        findings.push_back({bad, "store", printable(broker.trouble),
                            "jobs wait until the broker can write again: make room on its disk"});
    else
        findings.push_back(
            {good,
             "store",
             broker.keeps ? "jobs outlive the broker" : "jobs are kept in memory only",
             {}});
    if (broker.workers == 0)
        findings.push_back({doubtful, "workers", "there is none",
                            "start one on each machine: fraja-worker -b BROKER"});
    else if (broker.threads == 0)
        findings.push_back(
            {doubtful, "workers", fmt::format("{}, and none may be given tiles", broker.workers),
             "fraja-ctl workers shows who drains or is in quarantine; undrain them"});
    else
        findings.push_back(
            {good,
             "workers",
             fmt::format("{} with {}", broker.workers, counted(broker.threads, "thread")),
             {}});
    if (broker.threads > 0 && broker.jobs_ready > 0 && broker.tiles_in_flight == 0)
        findings.push_back({doubtful, "jobs",
                            counted(broker.jobs_ready, "job") + " to be rendered, and nobody at it",
                            "fraja-ctl show JOB says why it waits"});
    return findings;
}

discovery::Findings find_brokers(const std::string& source, const SharedOptions& shared) {
    return discovery::find_now(
        source, discovery::finder_options(shared.keys ? &shared.keys->broker : nullptr),
        std::min(shared.connect_timeout, patience));
}

BrokersExamined examine_brokers(const SharedOptions& shared, const net::SignalWatch* signals) {
    BrokersExamined all;
    std::set<BrokerId> seen;
    const auto is_ended_now = [&] {
        if (const auto signal =
                signals && !is_ended(all.outcome) ? signals->receive() : std::nullopt)
            all.outcome = outcome_of(*signal);
        return is_ended(all.outcome);
    };
    const auto examine = [&](const std::string& broker) {
        BrokerExamined one = examine_broker(broker, shared, signals);
        if (one.broker && *one.broker != BrokerId{} && !seen.insert(*one.broker).second)
            keep_way_alone(broker, one.findings);
        std::ranges::move(one.findings, std::back_inserter(all.findings));
        all.outcome = one.outcome;
    };
    for (const std::string& broker : shared.brokers) {
        std::vector<std::string> endpoints{broker};
        if (discovery::is_source(broker)) {
            auto found = find_brokers(broker, shared);
            all.findings.push_back(examine_source(found));
            endpoints = std::move(found.endpoints);
        }
        for (const std::string& endpoint : endpoints) {
            if (is_ended_now())
                return all;
            examine(endpoint);
        }
    }
    (void)is_ended_now();
    return all;
}

std::string findings_page(const std::vector<Finding>& machine,
                          const std::vector<Finding>& brokers) {
    std::size_t widest = 0;
    for (const auto& findings : {machine, brokers})
        for (const Finding& finding : findings)
            widest = std::max(widest, finding.subject.size());
    std::string page;
    for (const auto& findings : {machine, brokers}) {
        page += page.empty() ? "" : "\n";
        for (const Finding& f : findings) {
            const char* const grade = f.grade == good ? "ok" : f.grade == bad ? "BAD" : "hm";
            page += fmt::format("{:<4}{:<{}}  {}\n", grade, f.subject, widest, f.text);
            if (!f.cure.empty())
                page += fmt::format("    {:<{}}  -> {}\n", "", widest, f.cure);
        }
    }
    return page;
}

} // namespace fraja::client
