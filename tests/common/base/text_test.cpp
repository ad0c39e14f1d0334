#include "common/base/text.hpp"

#include <array>
#include <doctest/doctest.h>

using namespace fraja;
using namespace std::chrono_literals;

TEST_CASE("parse_extent takes WxH and nothing else") {
    struct Row {
        std::string_view text;
        std::optional<Extent> want;
    };
    for (const Row& row :
         {Row{"640x480", Extent{640, 480}}, Row{"0x0", Extent{0, 0}}, Row{"640x", std::nullopt},
          Row{"x480", std::nullopt}, Row{"640", std::nullopt}, Row{"", std::nullopt},
          Row{"640x480x3", std::nullopt}, Row{"-1x2", std::nullopt}, Row{" 640x480", std::nullopt},
          Row{"4294967296x1", std::nullopt}}) {
        CAPTURE(row.text);
        CHECK(parse_extent(row.text) == row.want);
    }
}

TEST_CASE("parse_rect takes X,Y,W,H and nothing else") {
    CHECK(parse_rect("1,2,30,40") == PixelRect{1, 2, 30, 40});
    for (const char* text : {"", "1,2,3", "1,2,3,", "1,2,3,4,5", "1;2;3;4", "-1,0,1,1"}) {
        CAPTURE(text);
        CHECK_FALSE(parse_rect(text).has_value());
    }
}

TEST_CASE("parse_duration reads seconds, units and sums of them") {
    struct Row {
        std::string_view text;
        std::optional<Duration> want;
    };
    for (const Row& row : {Row{"90", 90s}, Row{"90s", 90s}, Row{"5m", 5min}, Row{"1h30m", 90min},
                           Row{"250ms", 250ms}, Row{"1.5s", 1500ms}, Row{"7d", 168h}, Row{"0", 0s},
                           Row{"", std::nullopt}, Row{"s", std::nullopt}, Row{"-1s", std::nullopt},
                           Row{"1y", std::nullopt}, Row{"1 s", std::nullopt},
                           Row{"99999999999d", std::nullopt}, Row{"1e3", std::nullopt}}) {
        CAPTURE(row.text);
        CHECK(parse_duration(row.text) == row.want);
    }
}

TEST_CASE("parse_byte_size counts in powers of 1024 and refuses overflow") {
    CHECK(parse_byte_size("512") == 512u);
    CHECK(parse_byte_size("1K") == 1024u);
    CHECK(parse_byte_size("512M") == 512u << 20);
    CHECK(parse_byte_size("4G") == std::uint64_t{4} << 30);
    for (const char* text :
         {"", "K", "4X", "-4G", "4GB", "18446744073709551616", "99999999999999T"}) {
        CAPTURE(text);
        CHECK_FALSE(parse_byte_size(text).has_value());
    }
}

TEST_CASE("parse_share reads shares and percentages, from none to all") {
    CHECK(parse_share("0") == 0.0);
    CHECK(parse_share("0.1") == 0.1);
    CHECK(parse_share("1") == 1.0);
    CHECK(parse_share("10%") == 0.1);
    CHECK(parse_share("2.5%") == 0.025);
    CHECK(parse_share("100%") == 1.0);
    for (const char* text : {"", "%", "10", "1.1", "101%", "-0.1", "-1%", "0.1x", "1 %", "nan",
                             "inf", "1e-1", "0,1"}) {
        CAPTURE(text);
        CHECK_FALSE(parse_share(text).has_value());
    }
}

TEST_CASE("format_duration writes minutes and, when there are any, hours") {
    CHECK(format_duration(42s) == "0:42");
    CHECK(format_duration(727s) == "12:07");
    CHECK(format_duration(3723s) == "1:02:03");
    CHECK(format_duration(-5s) == "0:00");
    CHECK(format_duration(59'600ms) == "1:00");
    CHECK(format_duration(Duration::min()) == "0:00");
    CHECK(format_duration(Duration::max()) == "2562047:47:16");
}

TEST_CASE("a duration in words is the one that was read") {
    struct Row {
        const char *typed, *words;
    };
    for (const Row& row : {Row{"7", "7 seconds"}, Row{"7d", "7 days"}, Row{"24h", "1 day"},
                           Row{"0", "0 seconds"}, Row{"1h30m", "1 hour 30 minutes"},
                           Row{"61s", "1 minute 1 second"}, Row{"1.5s", "1.5 seconds"},
                           Row{"250ms", "0.25 seconds"}, Row{"1m50ms", "1 minute 0.05 seconds"}})
        CHECK(duration_in_words(*parse_duration(row.typed)) == row.words);
}

TEST_CASE("one is counted in the singular") {
    CHECK(counted(0, "job") == "0 jobs");
    CHECK(counted(1, "job") == "1 job");
    CHECK(counted(2, "more job") == "2 more jobs");
}

TEST_CASE("nearest_name finds slips and nothing far away") {
    constexpr std::array<std::string_view, 4> fields = {"center", "radius", "origin", "direction"};
    CHECK(nearest_name("radiu", fields) == "radius");
    CHECK(nearest_name("Radius", fields) == "radius");
    CHECK(nearest_name("centre", fields) == "center");
    CHECK(nearest_name("raduis", fields) == "radius");
    CHECK_FALSE(nearest_name("zzz", fields).has_value());
    CHECK_FALSE(nearest_name(std::string(100'000, 'a'), fields).has_value());
}

TEST_CASE("what others write cannot move the cursor") {
    CHECK(printable("cone") == "cone");
    CHECK(printable("a\nb\tc") == "a b c");
    CHECK(printable("\x1b[2Jx\r\x7f") == "?[2Jx??");
    CHECK(printable("\xc2\x9b"
                    "2J") == "?2J");
    CHECK(printable("gr\xc3\xbcn") == "gr\xc3\xbcn");
}

TEST_CASE("a clipped text ends between characters") {
    CHECK(clipped("cone", 10) == "cone");
    CHECK(clipped("cone", 4) == "cone");
    CHECK(clipped("cone", 3) == "con");
    CHECK(clipped("gr\xc3\xbcn", 4) == "gr\xc3\xbc");
    CHECK(clipped("gr\xc3\xbcn", 3) == "gr");
    CHECK(clipped("\xbc\xbc", 1).empty()); // no character begins here
    CHECK(clipped("x", 0).empty());
}
