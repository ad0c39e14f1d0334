// Who may say what, where there are keys.
#include "common/protocol/roles.hpp"
#include "tests/broker/farm.hpp"

#include <memory>

namespace fraja::broker {
namespace {

using namespace protocol;
using namespace std::chrono_literals;

Holder holder(const std::string& name, Roles roles) {
    return std::make_shared<KeyHolder>(KeyHolder{"key of " + name, name, roles});
}

WorkerHello hello(std::uint8_t id, std::uint64_t incarnation = 1) {
    WorkerHello h;
    h.worker = id_of<WorkerId>(id);
    h.incarnation = incarnation;
    h.worker_name = "w";
    h.threads = 1;
    h.credit = 2;
    return h;
}

BrokerHello broker_hello() {
    BrokerHello h;
    h.broker = id_of<BrokerId>(5);
    return h;
}

TileDone tile_done() {
    TileDone tile;
    tile.blobs = {Blob(Bytes(1))};
    return tile;
}

std::size_t times_logged(const Farm& farm, const std::string& kind) {
    return static_cast<std::size_t>(std::ranges::count(farm.logs, kind, &LogLine::kind));
}

void say(Farm& farm, const PeerId& peer, Message message, const Holder& with) {
    farm.forget(peer);
    farm.event(PeerSaid{peer, std::move(message), with});
}

bool is_refused(Farm& farm, const PeerId& peer) {
    const auto all = farm.all<Refused>(peer);
    return std::ranges::any_of(all,
                               [](const Refused& r) { return r.code == RefusalCode::not_allowed; });
}

TEST_CASE("a key's roles decide what is heard: the table of PROTOCOL.md") {
    struct Row {
        Message message;
        Roles may;
    };
    const Roles clients{Role::submit, Role::watch, Role::admin, Role::broker};
    for (const Row& row :
         {Row{hello(1), {Role::worker, Role::broker}},
          Row{WorkerBeat{}, {Role::worker, Role::broker}},
          Row{TileRendered{}, {Role::worker, Role::broker}},
          Row{TileFailed{}, {Role::worker, Role::broker}},
          Row{NeedChunk{}, {Role::worker, Role::broker}},
          Row{ClientHello{"c", "t"}, clients},
          Row{FindJob{"x"}, clients},
          Row{Repair{}, clients},
          Row{Farm::picture(1, 1), {Role::submit, Role::broker}},
          Row{Chunk{.blob = {}, .blobs = {Blob(Bytes(1))}}, {Role::submit, Role::broker}},
          Row{ControlJob{}, {Role::submit, Role::admin, Role::broker}},
          Row{ControlWorker{"w", WorkerDeed::kick}, {Role::admin, Role::broker}},
          Row{broker_hello(), {Role::broker}},
          Row{BrokerBeat{}, {Role::broker}},
          Row{CompareJobs{}, {Role::broker}},
          Row{JobDigests{}, {Role::broker}},
          Row{WantJob{}, {Role::broker}},
          Row{JobRecord{}, {Role::broker}},
          Row{JobKept{}, {Role::broker}},
          Row{JobForgotten{}, {Role::broker}},
          Row{tile_done(), {Role::broker}},
          Row{RepairDone{}, {Role::broker}},
          Row{Beat{}, Roles{Role::worker, Role::submit, Role::watch, Role::admin, Role::broker}},
          Row{Goodbye{},
              Roles{Role::worker, Role::submit, Role::watch, Role::admin, Role::broker}}})
        for (const Role role :
             {Role::worker, Role::submit, Role::watch, Role::admin, Role::broker}) {
            CAPTURE(name_of(row.message));
            CAPTURE(name_of(role));
            Farm farm;
            say(farm, "p", row.message, holder("p", {role}));
            CHECK(is_refused(farm, "p") == !row.may.has(role));
            CHECK((farm.dispatcher.counters().not_allowed == 1) == !row.may.has(role));
            // Whoever is not in the list may do nothing but go.
            say(farm, "s", row.message, holder("", {}));
            const bool is_free = std::holds_alternative<Beat>(row.message) ||
                                 std::holds_alternative<Goodbye>(row.message);
            CHECK(is_refused(farm, "s") == !is_free);
        }
}

TEST_CASE("a worker that cancels and a watcher that submits are refused, counted, logged once") {
    Farm farm;
    const Holder worker = holder("render farm", {Role::worker}),
                 watcher = holder("eve", {Role::watch}), ada = holder("ada", {Role::submit});
    say(farm, "w", hello(1), worker);
    say(farm, "c", ClientHello{"c", "t"}, ada);
    say(farm, "e", ClientHello{"e", "t"}, watcher);
    say(farm, "c", Farm::picture(1, 5), ada);
    say(farm, "c", Farm::scene_chunk(), ada);
    const JobId job = Farm::picture(1, 5).job;
    for (int i = 0; i < 3; ++i) {
        say(farm, "w", ControlJob{job, JobDeed::cancel, 0}, worker);
        CHECK(is_refused(farm, "w"));
        say(farm, "e", Farm::picture(2, 5), watcher);
        CHECK(farm.last<Refused>("e").reason ==
              "the key of eve lacks the role submit, which SubmitJob needs");
    }
    CHECK(farm.dispatcher.counters().not_allowed == 6);
    CHECK(times_logged(farm, "not_allowed") == 2);
    CHECK(farm.dispatcher.job_count() == 1);
    CHECK(!is_over(farm.state(job).phase));
    farm.now = farm.now + 11min; // it goes on: once more
    say(farm, "w", ControlJob{job, JobDeed::cancel, 0}, worker);
    CHECK(times_logged(farm, "not_allowed") == 3);
}

TEST_CASE("nobody but a broker of the farm comes to stand for this one") {
    Farm farm;
    const BrokerHello words = broker_hello();
    for (int i = 0; i < 3; ++i) {
        say(farm, "w", words, holder("render farm", {Role::worker}));
        CHECK(is_refused(farm, "w"));
        CHECK(farm.last<Refused>("w").reason ==
              "the key of render farm lacks the role broker, which BrokerHello needs");
    }
    CHECK(farm.dispatcher.counters().not_allowed == 3);
    CHECK(times_logged(farm, "not_allowed") == 1);
    CHECK(farm.dispatcher.membership().peers().empty());
    say(farm, "b", words, holder("a broker of this farm", {Role::broker}));
    CHECK(farm.heard<BrokerHello>("b"));
    CHECK(farm.dispatcher.membership().peers().size() == 1);
}

TEST_CASE("a key that is taken away ends its sessions at once, and its tiles go to others") {
    Farm farm;
    const Holder one = holder("one", {Role::worker}), two = holder("two", {Role::worker}),
                 ada = holder("ada", {Role::submit});
    say(farm, "1", hello(1), one);
    say(farm, "c", ClientHello{"c", "t"}, ada);
    say(farm, "c", Farm::picture(1, 2), ada);
    say(farm, "c", Farm::scene_chunk(), ada);
    CHECK(farm.tiles("1").size() == 2);
    say(farm, "2", hello(2), two);
    farm.forget("1");
    farm.event(RolesChanged{{{two->key, {Role::worker}}, {ada->key, {Role::watch}}}});
    CHECK(is_refused(farm, "1"));
    CHECK(farm.dispatcher.worker_count() == 1);
    CHECK(farm.tiles("2").size() == 2);
    CHECK(farm.dispatcher.client_count() == 1); // it may still look
    farm.event(RolesChanged{{{two->key, {Role::worker}}}});
    CHECK(farm.dispatcher.client_count() == 0);
    farm.event(RolesChanged{}); // all
    CHECK(farm.dispatcher.worker_count() == 0);
}

TEST_CASE("without keys a change of roles is nobody's affair") {
    Farm farm;
    farm.worker_arrives("w", 1, 1, 2);
    farm.client_arrives("c");
    farm.event(RolesChanged{});
    CHECK(farm.dispatcher.worker_count() == 1);
    CHECK(farm.dispatcher.client_count() == 1);
}

TEST_CASE("a worker is not replaced by who has its id and another key") {
    Farm farm;
    say(farm, "w", hello(1), holder("one", {Role::worker}));
    say(farm, "thief", hello(1, 9), holder("thief", {Role::worker}));
    CHECK(farm.last<Refused>("thief").code == RefusalCode::conflict);
    CHECK(farm.dispatcher.worker_count() == 1);
    say(farm, "again", hello(1, 9), holder("one", {Role::worker}));
    CHECK(farm.heard<Welcome>("again"));
}

} // namespace
} // namespace fraja::broker
