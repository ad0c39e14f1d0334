#include "common/net/keys.hpp"

#include "common/net/allow_list.hpp"
#include "common/net/sockets.hpp"

#include <chrono>
#include <doctest/doctest.h>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <sys/stat.h>
#include <unistd.h>

using namespace fraja;
using namespace fraja::net;
using namespace std::chrono_literals;
using protocol::Role;
using protocol::Roles;

namespace {

const KeyPair& farm_pair() {
    static const KeyPair pair = make_key_pair();
    return pair;
}

AllowList allow(const std::string& text) {
    auto list = AllowList::parse(text, "allow");
    REQUIRE(list.has_value());
    return AllowList(*list);
}

std::string entry(const std::string& roles, const KeyPair& pair, const std::string& name) {
    return roles + " " + pair.public_key.text + " " + name + "\n";
}

Keys keys_of(const KeyPair& own) {
    return {own, farm_pair().public_key};
}

protocol::Packet word(std::string_view body) {
    return {to_bytes("head"), to_bytes(body), {}};
}

/// Whether `happens` in good time.
template <class F>
bool soon(F happens) {
    const auto end = std::chrono::steady_clock::now() + 60s;
    while (!happens())
        if (std::chrono::steady_clock::now() > end)
            return false;
    return true;
}

/// Says it until it has left; nothing: until it is known why it cannot.
std::string say(DealerSocket& dealer, const protocol::Packet& p) {
    std::string why;
    REQUIRE(soon([&] {
        if (dealer.send(p) == SendStatus::sent)
            return true;
        wait({dealer}, 10ms);
        why = dealer.refusal();
        return !why.empty();
    }));
    return why;
}

RoutedMessage heard(RouterSocket& router) {
    std::optional<RoutedMessage> received;
    REQUIRE(soon([&] {
        wait({router}, 100ms);
        return (received = router.receive()).has_value();
    }));
    return *std::move(received);
}

RouterSocket bound(const Context& context) {
    auto router = RouterSocket::bind(context, "tcp://127.0.0.1:0");
    REQUIRE(router.has_value());
    return *std::move(router);
}

DealerSocket connected(const Context& context, const std::string& endpoint) {
    auto dealer = DealerSocket::connect(context, endpoint);
    REQUIRE(dealer.has_value());
    return *std::move(dealer);
}

} // namespace

TEST_CASE("a key pair is read again, and what is none is refused without quoting the secret") {
    const KeyPair pair = make_key_pair(), other = make_key_pair();
    CHECK(pair.public_key != other.public_key);
    const auto again = key_pair(pair.public_key.text, pair.secret.text());
    REQUIRE(again.has_value());
    CHECK(again->public_key == pair.public_key);
    for (const std::string& secret : {std::string(), std::string("short"), std::string(40, '~'),
                                      std::string(other.secret.text())}) {
        const auto refused = key_pair(pair.public_key.text, secret);
        REQUIRE(!refused.has_value());
        CHECK((secret.empty() || refused.error().message.find(secret) == std::string::npos));
    }
    for (const char* text : {"", "abc", "                                        "})
        CHECK(!parse_public_key(text).has_value());
    CHECK(!parse_public_key(std::string(40, '#')).has_value()); // beyond 32 bits
}

TEST_CASE("an allow-list names holders of keys and their roles, and of what is wrong the line") {
    const KeyPair ada = make_key_pair(), farm = make_key_pair();
    const AllowList list =
        allow("# who may do what\n\n" + entry("submit,admin", ada, "ada lovelace") + "  " +
              entry("worker", farm, "farm") + "\t# the end");
    CHECK(list.size() == 2);
    REQUIRE(list.find(ada.public_key.text));
    CHECK(list.find(ada.public_key.text)->name == "ada lovelace");
    CHECK((list.find(ada.public_key.text)->roles == Roles{Role::submit, Role::admin}));
    CHECK(!list.find(make_key_pair().public_key.text));
    CHECK_FALSE(list.find(farm.public_key.text)->is_shared);
    const AllowList many =
        allow(entry("workers", farm, "machines") + entry("watch,workers", ada, "a"));
    for (const KeyPair* pair : {&farm, &ada})
        CHECK(many.find(pair->public_key.text)->is_shared);
    CHECK((many.find(farm.public_key.text)->roles == Roles{Role::worker}));

    const std::string key = ada.public_key.text;
    struct Row {
        std::string text, says;
    };
    for (const Row& row :
         {Row{"\nwroker " + key + " x",
              "allow:2: there is no role 'wroker' (did you mean 'worker'?): worker, workers, "},
          Row{"broker " + key + " x", "allow:1: there is no role 'broker'"},
          Row{"worker, " + key + " x", "allow:1: there is no role ''"},
          Row{"worker abc x", "allow:1: 'abc' is no public key"},
          Row{"worker " + key, "allow:1: behind the key stands whose it is"},
          Row{"worker " + key + " " + std::string(201, 'x'), "1 to 200 bytes"},
          Row{"worker " + key + " a\n#\nsubmit " + key + " b",
              "allow:3: that key stands in line 1"},
          Row{"#" + std::string(allow_line_bytes_max, 'x'),
              "allow:1: a line has at most 1000 bytes"}}) {
        CAPTURE(row.text);
        const auto refused = AllowList::parse(row.text, "allow");
        REQUIRE(!refused.has_value());
        CHECK(refused.error().message.find(row.says) != std::string::npos);
    }
}

TEST_CASE("an allow-list has a limit of keys") {
    std::string text;
    // Public keys need be nobody's: any 40 characters that decode.
    for (std::size_t i = 0; i <= allow_entries_max; ++i) {
        std::string number = std::to_string(i);
        text += "worker " + std::string(40 - number.size(), '0') + number + " w\n";
    }
    const auto refused = AllowList::parse(text, "allow");
    REQUIRE(!refused.has_value());
    CHECK(refused.error().message == "allow:100001: there are at most 100000 keys");
    CHECK(AllowList::parse(text.substr(0, text.rfind("worker")), "allow").has_value());
}

TEST_CASE("an allow-list that others may write to, or that is somebody else's, is refused") {
    const auto file =
        std::filesystem::temp_directory_path() / ("fraja-allow-" + std::to_string(getpid()));
    std::ofstream(file) << entry("worker", make_key_pair(), "w");
    chmod(file.c_str(), 0644);
    CHECK(AllowList::read(file).has_value());
    chmod(file.c_str(), 0664);
    const auto refused = AllowList::read(file);
    REQUIRE(!refused.has_value());
    CHECK(refused.error().message.find("chmod go-w") != std::string::npos);
    chmod(file.c_str(), 0644);
    if (geteuid() == 0) {
        REQUIRE(chown(file.c_str(), 12345, 12345) == 0);
        const auto not_ours = AllowList::read(file);
        REQUIRE(!not_ours.has_value());
        CHECK(not_ours.error().message.find("it is somebody else's file") != std::string::npos);
        CHECK(not_ours.error().message.find("chown 0 " + file.string()) != std::string::npos);
    } else {
        MESSAGE("only root can give a file away: that somebody else's is refused is not tried");
    }
    std::filesystem::remove(file);
    CHECK(AllowList::read(file).error().code == ErrorCode::io);
}

TEST_CASE("a message says whose key it came with, and a new list holds at once") {
    const KeyPair ada = make_key_pair();
    const Context farm(keys_of(farm_pair())), hers(keys_of(ada));
    REQUIRE(farm.admit(allow(entry("submit", ada, "ada"))).has_value());
    RouterSocket router = bound(farm);
    DealerSocket dealer = connected(hers, router.endpoint());
    CHECK(say(dealer, word("hello")).empty());
    const RoutedMessage hello = heard(router);
    REQUIRE(hello.holder);
    CHECK((*hello.holder == protocol::KeyHolder{ada.public_key.text, "ada", {Role::submit}}));
    CHECK(router.send(hello.peer, word("welcome")) == SendStatus::sent);

    REQUIRE(farm.admit(allow(entry("watch", ada, "ada"))).has_value());
    CHECK(say(dealer, word("again")).empty());
    CHECK((heard(router).holder->roles == Roles{Role::watch}));
    REQUIRE(farm.admit(AllowList{}).has_value());
    CHECK(say(dealer, word("once more")).empty()); // the connection stands
    const RoutedMessage last = heard(router);
    CHECK(last.holder->roles.empty());
    CHECK(last.holder->key == ada.public_key.text);
    CHECK(farm.refused_count() == 0);
}

TEST_CASE("the farm's own key is another broker's") {
    const Context farm(keys_of(farm_pair())), peer(keys_of(farm_pair()));
    REQUIRE(farm.admit(AllowList{}).has_value());
    RouterSocket router = bound(farm);
    DealerSocket dealer = connected(peer, router.endpoint());
    CHECK(say(dealer, word("hello")).empty());
    CHECK((heard(router).holder->roles == Roles{Role::broker}));
}

TEST_CASE("whom a broker does not let in is told why at once, and tried again") {
    const KeyPair ada = make_key_pair(), stranger = make_key_pair();
    const Context farm(keys_of(farm_pair())), open;
    REQUIRE(farm.admit(allow(entry("submit", ada, "ada"))).has_value());
    RouterSocket closed_router = bound(farm), open_router = bound(open);
    const auto is_counted_as_keyless = [&] {
        return soon([&] {
            wait({closed_router}, 10ms);
            return !closed_router.receive() && farm.keyless_count() > 0;
        });
    };

    SUBCASE("a stranger's key is counted, told of once, and welcome when it is in the list") {
        const Context his(keys_of(stranger));
        DealerSocket dealer = connected(his, closed_router.endpoint());
        CHECK(say(dealer, word("x")).find("refuses our key") != std::string::npos);
        REQUIRE(soon([&] { // it tries again by itself
            (void)dealer.send(word("x"));
            wait({dealer}, 10ms);
            return farm.refused_count() >= 2;
        }));
        const auto strangers = farm.take_strangers();
        REQUIRE(strangers.size() == 1);
        CHECK(!closed_router.receive());
        CHECK(farm.keyless_count() == 0);
        CHECK(strangers[0].key == stranger.public_key.text);
        CHECK(strangers[0].address == "127.0.0.1");
        CHECK(farm.take_strangers().empty());
        REQUIRE(farm.admit(allow(entry("submit", stranger, "no stranger"))).has_value());
        REQUIRE(soon([&] {
            wait({dealer}, 10ms);
            return dealer.send(word("x")) == SendStatus::sent;
        }));
        CHECK(dealer.refusal().empty());
        CHECK(heard(closed_router).holder->name == "no stranger");
    }
    SUBCASE("who has no key") {
        DealerSocket dealer = connected(open, closed_router.endpoint());
        CHECK(say(dealer, word("x")).find("we have none") != std::string::npos);
        CHECK(is_counted_as_keyless());
        CHECK(farm.refused_count() == 0);
    }
    SUBCASE("who has one, at a broker without keys: nothing is said unencrypted") {
        const Context hers(keys_of(ada));
        DealerSocket dealer = connected(hers, open_router.endpoint());
        CHECK(say(dealer, word("x")).find("has no keys") != std::string::npos);
        CHECK(!open_router.receive());
    }
    SUBCASE("who takes it for another broker") {
        const Context hers(Keys{ada, stranger.public_key});
        DealerSocket dealer = connected(hers, closed_router.endpoint());
        CHECK(say(dealer, word("x")).find("--broker-key") != std::string::npos);
        CHECK(is_counted_as_keyless());
    }
    CHECK(!closed_router.receive());
}

TEST_CASE("the stream is for those who may look, and a worker's door for those who may submit") {
    const KeyPair ada = make_key_pair(), worker = make_key_pair();
    const Context farm(keys_of(farm_pair())), hers(keys_of(ada)), its(keys_of(worker));
    REQUIRE(
        farm.admit(allow(entry("watch", ada, "ada") + entry("worker", worker, "w"))).has_value());
    auto publisher = PublisherSocket::bind(farm, "tcp://127.0.0.1:0", 10);
    REQUIRE(publisher.has_value());
    auto subscriber = SubscriberSocket::connect(hers, publisher->endpoint());
    auto spy = SubscriberSocket::connect(its, publisher->endpoint());
    REQUIRE((subscriber.has_value() && spy.has_value()));
    spy->subscribe("spied");
    REQUIRE(soon([&] { return farm.refused_count() > 0; }));
    CHECK(farm.take_strangers().at(0).why.find("lacks the role submit or watch or admin") !=
          std::string::npos);
    subscriber->subscribe("T");
    std::optional<SubscriptionChange> change;
    REQUIRE(soon([&] {
        wait({*publisher}, 100ms);
        return (change = publisher->receive()).has_value();
    }));
    CHECK(change->topic == "T");
    publisher->publish("T", word("tile"));
    std::optional<PublishedMessage> published;
    REQUIRE(soon([&] {
        wait({*subscriber}, 100ms);
        return (published = subscriber->receive()).has_value();
    }));

    auto callee = CalleeSocket::bind(farm, "tcp://127.0.0.1:0");
    REQUIRE(callee.has_value());
    const std::uint64_t before = farm.refused_count();
    RouterSocket watcher = bound(hers);
    REQUIRE(watcher.call(callee->endpoint()).has_value());
    REQUIRE(soon([&] { return farm.refused_count() > before; }));
    CHECK(!callee->receive());
    REQUIRE(farm.admit(allow(entry("submit", worker, "submitter"))).has_value());
    RouterSocket caller = bound(its);
    REQUIRE(caller.call(callee->endpoint()).has_value());
    REQUIRE(soon([&] {
        wait({*callee}, 100ms);
        (void)caller.receive(); // it has to take note of its own connection
        (void)callee->receive();
        return callee->caller() != 0;
    }));

    // Who may not any more is given up with the next word.
    REQUIRE(callee->send(word("hello")) == SendStatus::sent);
    const PeerId worker_there = heard(caller).peer;
    const auto say_and_hear = [&] {
        (void)caller.send(worker_there, word("welcome"));
        wait({*callee}, 10ms);
        return callee->receive();
    };
    REQUIRE(soon([&] { return say_and_hear().has_value(); }));
    REQUIRE(farm.admit(allow(entry("watch", worker, "submitter"))).has_value());
    REQUIRE(soon([&] { return !say_and_hear() && callee->caller() == 0; }));
    CHECK(!say_and_hear());
}

TEST_CASE("strangers without number fill no memory") {
    const Context farm(keys_of(farm_pair()));
    REQUIRE(farm.admit(AllowList{}).has_value());
    RouterSocket router = bound(farm);
    constexpr int strangers = 40;
    for (int i = 0; i < strangers; ++i) {
        const Context his(keys_of(make_key_pair()));
        DealerSocket dealer = connected(his, router.endpoint());
        CHECK(!say(dealer, word("x")).empty());
    }
    CHECK(farm.refused_count() >= strangers);
    CHECK(farm.take_strangers().size() == strangers);
}
