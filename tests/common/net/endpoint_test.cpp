#include "common/net/endpoint.hpp"

#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::net;

TEST_CASE("endpoints are read in all their forms and others are refused with a reason") {
    struct Row {
        std::string_view text;
        std::string_view want; ///< empty: refused
    };
    for (const Row& row : {
             Row{"tcp://127.0.0.1:50057", "tcp://127.0.0.1:50057"},
             Row{"tcp://127.0.0.1", "tcp://127.0.0.1:7"},
             Row{"farm.example:99", "tcp://farm.example:99"},
             Row{"farm", "tcp://farm:7"},
             Row{"tcp://[::1]:5", "tcp://[::1]:5"},
             Row{"tcp://[::1]", "tcp://[::1]:7"},
             Row{"tcp://*:0", "tcp://*:0"},
             Row{"ipc:///run/fraja", "ipc:///run/fraja"},
             Row{"inproc://broker", "inproc://broker"},
             Row{"", ""},
             Row{"tcp://", ""},
             Row{"tcp://:5", ""},
             Row{"tcp://h:", ""},
             Row{"tcp://h:70000", ""},
             Row{"tcp://h:-1", ""},
             Row{"tcp://h:5x", ""},
             Row{"tcp://[::1:5", ""},
             Row{"tcp://a b:5", ""},
             Row{"tcp://a/b:5", ""},
             Row{"pgm://eth0;239.0.0.1:5", ""},
             Row{"udp://h:5", ""},
             Row{"ipc://", ""},
         }) {
        CAPTURE(row.text);
        const auto endpoint = parse_endpoint(row.text, 7);
        CHECK(endpoint.has_value() == !row.want.empty());
        if (endpoint)
            CHECK(to_string(*endpoint) == row.want);
        else
            CHECK(endpoint.error().code == ErrorCode::invalid_argument);
    }
    CHECK_FALSE(parse_endpoint("ipc://" + std::string(200, 'x'), 7).has_value());
}

TEST_CASE("loopback is what only this machine can reach") {
    const auto loopback = [](std::string_view text) {
        return is_loopback(*parse_endpoint(text, 1));
    };
    for (const char* text :
         {"127.0.0.1", "127.9.9.9", "localhost", "[::1]", "ipc:///x", "inproc://x"})
        CHECK(loopback(text));
    for (const char* text :
         {"*", "0.0.0.0", "192.0.2.1", "[::]", "farm.example", "localhost.example"})
        CHECK_FALSE(loopback(text));
}

TEST_CASE("an endpoint is bound off loopback only where that is said to be meant") {
    const auto bindable = [](std::string_view text, bool insecure) {
        const auto endpoint = endpoint_to_bind(text, 7, insecure);
        return endpoint ? *endpoint : endpoint.error().message;
    };
    CHECK(bindable("127.0.0.1", false) == "tcp://127.0.0.1:7");
    CHECK(bindable("tcp://localhost:0", false) == "tcp://127.0.0.1:0"); // as ZeroMQ wants it
    CHECK(bindable("tcp://*:0", false).find("--insecure") != std::string::npos);
    CHECK(bindable("tcp://*:0", true) == "tcp://*:0");
    CHECK(bindable("pgm://x", true).find("transport") != std::string::npos);
}

TEST_CASE("what is only good to listen at is not connected to") {
    const auto connectable = [](std::string_view text, std::uint16_t default_port) {
        const auto endpoint = endpoint_to_connect(text, default_port);
        return endpoint ? *endpoint : endpoint.error().message;
    };
    CHECK(connectable("farm", 7) == "tcp://farm:7");
    CHECK(connectable("tcp://[::1]:65535", 0) == "tcp://[::1]:65535");
    CHECK(connectable("ipc:///run/fraja", 7) == "ipc:///run/fraja");
    CHECK(connectable("tcp://*:50057", 7).find("place to listen") != std::string::npos);
    CHECK(connectable("farm:0", 7).find("a port is missing") != std::string::npos);
    CHECK(connectable("farm", 0).find("a port is missing") != std::string::npos);
    CHECK(connectable("inproc://broker", 7).find("inproc") != std::string::npos);
    CHECK(connectable("pgm://x", 7).find("transport") != std::string::npos);
}

TEST_CASE("the stream is looked for at the host that was reached") {
    const auto stream = [](std::string_view reached, std::string_view told) {
        const auto endpoint = stream_endpoint(reached, told);
        return endpoint ? *endpoint : "refused";
    };
    CHECK(stream("tcp://farm:50057", "tcp://0.0.0.0:50058") == "tcp://farm:50058");
    CHECK(stream("tcp://127.0.0.1:1", "tcp://[::]:2") == "tcp://127.0.0.1:2");
    CHECK(stream("inproc://a", "inproc://b") == "inproc://b");
    CHECK(stream("tcp://farm:1", "rubbish://x") == "refused");
}
