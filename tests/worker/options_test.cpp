#include "worker/options.hpp"

#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::worker;

TEST_CASE("options are checked before anything is sent") {
    const WorkerOptions good{
        .brokers = {"tcp://h:1"}, .threads = 2, .name = "n", .tags = {"a", "b=c"}, .on_log = {}};
    CHECK(validate(good).has_value());
    struct Row {
        const char* option;
        void (*spoil)(WorkerOptions&);
    };
    for (const Row& row :
         {Row{"--broker", [](WorkerOptions& o) { o.brokers.clear(); }},
          Row{"--threads 0", [](WorkerOptions& o) { o.threads = 0; }},
          Row{"--threads", [](WorkerOptions& o) { o.threads = threads_max + 1; }},
          Row{"--name", [](WorkerOptions& o) { o.name = ""; }},
          Row{"--name", [](WorkerOptions& o) { o.name = std::string(201, 'x'); }},
          Row{"--tag", [](WorkerOptions& o) { o.tags = std::vector<std::string>(65, "x"); }},
          Row{"--tag '=v'", [](WorkerOptions& o) { o.tags = {"=v"}; }},
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
                                .on_log = {}};
    CHECK(validate(options).has_value());
    CHECK(default_worker_name().find(':') != std::string::npos);
}
