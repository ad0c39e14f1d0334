#include "worker/options.hpp"

#include <doctest/doctest.h>
#include <optional>
#include <string>

using namespace fraja;
using namespace fraja::worker;

TEST_CASE("options are checked before anything is sent") {
    const WorkerOptions good{.brokers = {"tcp://h:1"},
                             .threads = 2,
                             .name = "n",
                             .tags = {"a", "b=c"},
                             .emulated = {{3, 1e3}},
                             .on_log = {}};
    CHECK(validate(good).has_value());
    struct Row {
        const char* option;
        void (*spoil)(WorkerOptions&);
    };
    for (const Row& row :
         {Row{"--broker", [](WorkerOptions& o) { o.brokers.clear(); }},
          Row{"--listen and --broker", [](WorkerOptions& o) { o.listen = "tcp://127.0.0.1:0"; }},
          Row{"--insecure", [](WorkerOptions& o) { o.insecure = true; }},
          Row{"--threads 0", [](WorkerOptions& o) { o.threads = 0; }},
          Row{"--threads", [](WorkerOptions& o) { o.threads = threads_max + 1; }},
          Row{"--name", [](WorkerOptions& o) { o.name = ""; }},
          Row{"--name", [](WorkerOptions& o) { o.name = std::string(201, 'x'); }},
          Row{"--tag", [](WorkerOptions& o) { o.tags = std::vector<std::string>(65, "x"); }},
          Row{"--tag '=v'", [](WorkerOptions& o) { o.tags = {"=v"}; }},
          Row{"--emulate: COUNT",
              [](WorkerOptions& o) {
                  o.emulated = {{0, 1e3}};
              }},
          Row{"--emulate: COUNT",
              [](WorkerOptions& o) {
                  o.emulated = {{1, 0}};
              }},
          Row{"--emulate: at most 10000",
              [](WorkerOptions& o) {
                  o.emulated = {{9000, 1}, {9000, 1}};
              }},
          Row{"--name: with /3", [](WorkerOptions& o) { o.name = std::string(199, 'x'); }},
          Row{"--tag: at most 63",
              [](WorkerOptions& o) { o.tags = std::vector<std::string>(64, "x"); }},
          Row{"--tag ''", [](WorkerOptions& o) { o.tags = {""}; }}}) {
        CAPTURE(row.option);
        WorkerOptions options = good;
        row.spoil(options);
        const auto valid = validate(options);
        REQUIRE_FALSE(valid.has_value());
        CHECK(valid.error().message.starts_with(row.option));
    }
}

TEST_CASE("the defaults are valid options") {
    const WorkerOptions options{.brokers = {"tcp://h:1"},
                                .threads = usable_cpu_count(),
                                .name = default_worker_name(),
                                .tags = {},
                                .emulated = {},
                                .on_log = {}};
    CHECK(validate(options).has_value());
    CHECK(default_worker_name().find(':') != std::string::npos);
}

TEST_CASE(
    "workers that listen have a port each, and are for this machine alone unless it is said") {
    using Endpoints = std::vector<std::string>;
    const auto endpoints = [](const char* listen, std::uint64_t count, bool insecure = false) {
        auto all = listening_endpoints(listen, insecure, count);
        return all ? *all : Endpoints{all.error().message};
    };
    CHECK(endpoints("tcp://127.0.0.1:0", 2) == Endpoints{"tcp://127.0.0.1:0", "tcp://127.0.0.1:0"});
    CHECK(endpoints("localhost:65533", 3) ==
          Endpoints{"tcp://127.0.0.1:65533", "tcp://127.0.0.1:65534", "tcp://127.0.0.1:65535"});
    CHECK(endpoints("tcp://*:7001", 2, true) == Endpoints{"tcp://*:7001", "tcp://*:7002"});
    struct Row {
        const char *listen, *says;
    };
    for (const Row& row :
         {Row{"tcp://*:7001", "--insecure"}, Row{"tcp://192.0.2.1:0", "--insecure"},
          Row{"tcp://127.0.0.1:65534", "3 workers need as many ports"},
          Row{"ipc:///tmp/x", "tcp://HOST:PORT"}, Row{"pgm://x", "transport"},
          Row{"127.0.0.1:x", "port"}}) {
        CAPTURE(row.listen);
        WorkerOptions options;
        options.name = "n";
        options.listen = row.listen;
        options.emulated = {{3, 1e3}};
        const auto valid = validate(options);
        REQUIRE_FALSE(valid.has_value());
        CHECK(valid.error().message.starts_with("--listen"));
        CHECK(valid.error().message.find(row.says) != std::string::npos);
    }
    WorkerOptions options;
    options.name = "n";
    options.listen = "127.0.0.1:0";
    CHECK(validate(options).has_value());
    CHECK(session_count(options) == 1);
}

TEST_CASE("each worker has a session with every broker, and one that listens a single one") {
    WorkerOptions options;
    options.brokers = {"tcp://h:1", "tcp://h:2"};
    CHECK(session_count(options) == 2);
    options.emulated = {{3, 1e3}, {1, 2e3}};
    options.name = "n";
    CHECK(validate(options).has_value());
    CHECK(session_count(options) == 8);
    options.brokers.clear();
    options.listen = "127.0.0.1:0";
    CHECK(session_count(options) == 4);
}

TEST_CASE("parse_emulated_workers takes COUNT@SPEED and nothing else") {
    struct Row {
        const char* text;
        std::optional<EmulatedWorkers> want;
    };
    for (const Row& row : {Row{"16@3k", EmulatedWorkers{16, 3000}},
                           Row{"1@8791.5", EmulatedWorkers{1, 8791.5}},
                           Row{"10000@2.5M", EmulatedWorkers{10'000, 2.5e6}},
                           Row{"2@1G", EmulatedWorkers{2, 1e9}},
                           Row{"1@.5", EmulatedWorkers{1, .5}},
                           Row{"", {}},
                           Row{"16", {}},
                           Row{"@3k", {}},
                           Row{"16@", {}},
                           Row{"16@k", {}},
                           Row{"0@3k", {}},
                           Row{"10001@3k", {}},
                           Row{"16@0", {}},
                           Row{"16@-3", {}},
                           Row{"-1@3", {}},
                           Row{"16@3kk", {}},
                           Row{"16@3K", {}},
                           Row{"16@nan", {}},
                           Row{"16@inf", {}},
                           Row{"16@1e3", {}},
                           Row{"16@1.2.3", {}},
                           Row{"16 @3k", {}},
                           Row{"16@ 3k", {}},
                           Row{"16@3@3", {}},
                           Row{"1@1000001G", {}},
                           Row{"1@0.0001", {}},
                           Row{"99999999999999999999@1", {}}}) {
        CAPTURE(row.text);
        const auto got = parse_emulated_workers(row.text);
        CHECK(got.has_value() == row.want.has_value());
        if (got)
            CHECK(*got == *row.want);
        else
            CHECK(got.error().message.starts_with("--emulate "));
    }
}
