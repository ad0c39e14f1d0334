// PROTOCOL.md is the contract: this reads the page and fails when page and code drift.
#include "common/protocol/limits.hpp"
#include "common/protocol/messages.hpp"
#include "common/protocol/roles.hpp"
#include "tests/support/messages.hpp"

#include <algorithm>
#include <doctest/doctest.h>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <sstream>

using namespace fraja;
using namespace fraja::protocol;

namespace {

struct PageField {
    std::string name, type;
    friend bool operator==(const PageField&, const PageField&) = default;
};
std::ostream& operator<<(std::ostream& out, const PageField& f) {
    return out << f.name << ": " << f.type;
}

/// What the page says: fields by heading ("30 RenderTile", "Rays"), in the order of the page.
struct Page {
    std::vector<std::string> headings;
    std::map<std::string, std::vector<PageField>> fields;
    std::map<std::string, std::string> rows; ///< the other tables: first cell -> second cell
    std::string text;
};

std::vector<std::string> cells(const std::string& line) {
    std::vector<std::string> result;
    std::istringstream in(line.substr(1));
    for (std::string cell; std::getline(in, cell, '|');) {
        const auto first = cell.find_first_not_of(' '), last = cell.find_last_not_of(' ');
        result.push_back(first == std::string::npos ? "" : cell.substr(first, last - first + 1));
    }
    return result;
}

Page read_page() {
    std::ifstream in(FRAJA_SOURCE_DIR "/common/protocol/PROTOCOL.md");
    REQUIRE(in.good());
    Page page;
    std::string heading;
    for (std::string line; std::getline(in, line);) {
        page.text += line + "\n";
        if (line.starts_with("#")) {
            heading = line.substr(line.find_first_not_of("# "));
            if (line.starts_with("### "))
                page.headings.push_back(heading);
        } else if (line.starts_with("|") && !line.starts_with("|-")) {
            const auto row = cells(line);
            if (row.size() == 3 && row[0] != "field" && row[0].find('`') == std::string::npos)
                page.fields[heading].push_back({row[0], row[1]});
            if (row.size() >= 2)
                page.rows[row[0]] = row[1];
        }
    }
    return page;
}

template <class T>
std::string type_name() {
    if constexpr (std::is_same_v<T, bool>)
        return "bool";
    else if constexpr (std::is_same_v<T, double>)
        return "f64";
    else if constexpr (std::is_same_v<T, std::string>)
        return "str";
    else if constexpr (std::is_same_v<T, Bytes>)
        return "bytes";
    else if constexpr (std::is_same_v<T, Duration>)
        return "ns";
    else if constexpr (std::is_same_v<T, ContentHash>)
        return "hash";
    else if constexpr (requires(T t) { t.bytes.data(); })
        return "uuid";
    else if constexpr (std::is_same_v<T, KernelChoice>)
        return "KernelChoice";
    else if constexpr (std::is_same_v<T, PixelFilter>)
        return "PixelFilter";
    else if constexpr (std::is_same_v<T, TileOrder>)
        return "TileOrder";
    else if constexpr (std::is_same_v<T, JobPhase>)
        return "JobPhase";
    else if constexpr (std::is_same_v<T, RefusalCode>)
        return "RefusalCode";
    else if constexpr (std::is_same_v<T, FailureCode>)
        return "FailureCode";
    else if constexpr (std::is_same_v<T, Schedule>)
        return "Schedule";
    else if constexpr (std::is_same_v<T, JobDeed>)
        return "JobDeed";
    else if constexpr (std::is_same_v<T, WorkerDeed>)
        return "WorkerDeed";
    else if constexpr (std::is_enum_v<T>)
        return type_name<std::underlying_type_t<T>>();
    else if constexpr (std::is_integral_v<T>)
        return (std::is_signed_v<T> ? "i" : "u") + std::to_string(8 * sizeof(T));
    else if constexpr (detail::is_vector_v<T>)
        return "[" + type_name<typename T::value_type>() + "]";
    else if constexpr (std::is_same_v<T, Extent>)
        return "Extent";
    else if constexpr (std::is_same_v<T, PixelRect>)
        return "PixelRect";
    else if constexpr (std::is_same_v<T, PictureSettings>)
        return "PictureSettings";
    else if constexpr (std::is_same_v<T, Rays>)
        return "Rays";
    else if constexpr (std::is_same_v<T, TileInFlight>)
        return "TileInFlight";
    else if constexpr (std::is_same_v<T, WorkerState>)
        return "WorkerState";
    else if constexpr (std::is_same_v<T, BrokerState>)
        return "BrokerState";
    else if constexpr (std::is_same_v<T, Wishes>)
        return "Wishes";
    else if constexpr (std::is_same_v<T, Distrusted>)
        return "Distrusted";
    else if constexpr (std::is_same_v<T, CheckCounts>)
        return "CheckCounts";
    else if constexpr (std::is_same_v<T, Term>)
        return "Term";
    else if constexpr (std::is_same_v<T, Member>)
        return "Member";
    else if constexpr (std::is_same_v<T, Revision>)
        return "Revision";
    else if constexpr (std::is_same_v<T, JobDigest>)
        return "JobDigest";
    else if constexpr (std::is_same_v<T, PeerState>)
        return "PeerState";
    else
        return std::string(T::name);
}

template <class T>
std::vector<PageField> code_fields() {
    std::vector<PageField> fields;
    std::apply(
        [&](const auto&... field) {
            (fields.push_back(
                 {std::string(field.name),
                  type_name<std::decay_t<decltype(std::declval<T&>().*(field.member))>>()}),
             ...);
        },
        FieldsOf<T>::fields());
    return fields;
}

std::string joined(const std::vector<std::string>& names) {
    std::string result;
    for (const auto& name : names)
        result += (result.empty() ? "" : ", ") + name;
    return result;
}

/// The enumerators of an enum as the header has them, in order: C++20 cannot name them itself.
std::vector<std::string> enumerators(const std::string& name) {
    std::string source;
    for (const char* header : {"messages.hpp", "settings.hpp"}) {
        std::ifstream in(std::string(FRAJA_SOURCE_DIR "/common/protocol/") + header);
        REQUIRE(in.good());
        for (std::string line; std::getline(in, line);)
            source += line.substr(0, line.find("//")) + "\n";
    }
    const auto begin = source.find('{', source.find("enum class " + name + " "));
    REQUIRE(begin != std::string::npos);
    const std::string body = source.substr(begin, source.find('}', begin) - begin);
    const std::regex word("[a-z_0-9]+");
    return {std::sregex_token_iterator(body.begin(), body.end(), word), {}};
}

} // namespace

TEST_CASE("the page describes every message and record with its fields in order") {
    const Page page = read_page();
    std::vector<std::string> want;
    const auto compare = [&]<class T>(std::type_identity<T>, const std::string& heading) {
        CAPTURE(heading);
        want.push_back(heading);
        const auto found = page.fields.find(heading);
        const auto on_page = found == page.fields.end() ? std::vector<PageField>{} : found->second;
        const auto in_code = code_fields<T>();
        REQUIRE(on_page.size() == in_code.size());
        for (std::size_t i = 0; i < in_code.size(); ++i)
            CHECK(on_page[i] == in_code[i]);
    };
    want = {"Types", "Limits"};
    compare(std::type_identity<Extent>{}, "Extent");
    compare(std::type_identity<PixelRect>{}, "PixelRect");
    compare(std::type_identity<PictureSettings>{}, "PictureSettings");
    compare(std::type_identity<Rays>{}, "Rays");
    compare(std::type_identity<TileInFlight>{}, "TileInFlight");
    compare(std::type_identity<Term>{}, "Term");
    compare(std::type_identity<Member>{}, "Member");
    compare(std::type_identity<Revision>{}, "Revision");
    compare(std::type_identity<JobDigest>{}, "JobDigest");
    compare(std::type_identity<WorkerState>{}, "WorkerState");
    compare(std::type_identity<BrokerState>{}, "BrokerState");
    compare(std::type_identity<PeerState>{}, "PeerState");
    compare(std::type_identity<Wishes>{}, "Wishes");
    compare(std::type_identity<Distrusted>{}, "Distrusted");
    compare(std::type_identity<CheckCounts>{}, "CheckCounts");
    for_each_message_type([&]<class M>(std::type_identity<M> m) {
        compare(m, std::to_string(M::type) + " " + std::string(M::name));
    });
    CHECK(joined(page.headings) == joined(want)); // none missing, none too many, in the same order
}

TEST_CASE("the page has what came with this version, and no other mark is left") {
    const Page page = read_page();
    std::vector<PageField> want; // where, and what
    std::vector<std::string> messages;
    const auto look = [&]<class T>(std::type_identity<T>, std::string_view name) {
        std::vector<std::string> fields;
        bool is_last = false;
        const auto note = [&](const auto& field) {
            CAPTURE(field.name);
            CHECK((field.since == 0 || field.since == version));
            CHECK((field.since == version || !is_last)); // fields come at the end
            is_last = field.since == version;
            if (is_last)
                fields.emplace_back(field.name);
        };
        std::apply([&](const auto&... field) { (note(field), ...); }, FieldsOf<T>::fields());
        if (!fields.empty())
            want.push_back({std::string(name), joined(fields)});
    };
    look(std::type_identity<TileInFlight>{}, "TileInFlight");
    look(std::type_identity<WorkerState>{}, "WorkerState");
    look(std::type_identity<BrokerState>{}, "BrokerState");
    look(std::type_identity<Wishes>{}, "Wishes");
    for_each_message_type([&]<class M>(std::type_identity<M> m) {
        CHECK((since<M> == 0 || since<M> == version));
        look(m, M::name);
        if (since<M> == version)
            messages.emplace_back(M::name);
    });
    auto on_page = page.fields.at("Versions");
    std::erase_if(on_page, [](const PageField& row) { return row.name == "where"; });
    CHECK(on_page == want);
    messages.back().insert(0, "and ");
    std::string sentence = joined(messages);
    sentence.erase(sentence.rfind(','), 1);
    CHECK(page.text.find("With " + std::to_string(version) + " also came " + sentence) !=
          std::string::npos);
}

TEST_CASE("no two messages have the same number or name") {
    std::set<std::uint16_t> numbers;
    std::set<std::string_view> names;
    for_each_message_type([&]<class M>(std::type_identity<M>) {
        CHECK(numbers.insert(M::type).second);
        CHECK(names.insert(M::name).second);
    });
}

TEST_CASE("the page has the limits of the code and no other") {
    const Page page = read_page();
    const std::map<std::string, std::uint64_t> limits = {
        {"frame_bytes_max", frame_bytes_max},
        {"message_frames_max", message_frames_max},
        {"string_bytes_max", string_bytes_max},
        {"name_bytes_max", name_bytes_max},
        {"tags_max", tags_max},
        {"credit_max", credit_max},
        {"nesting_max", nesting_max},
        {"chunk_bytes", chunk_bytes},
        {"scene_bytes_max", scene_bytes_max},
        {"picture_side_max", picture_side_max},
        {"picture_pixels_max", picture_pixels_max},
        {"tile_side_max", tile_side_max},
        {"cells_per_job_max", cells_per_job_max},
        {"brokers_max", brokers_max},
        {"distrusted_max", distrusted_max},
        {"probe_squares_max", probe_squares_max},
        {"depth_max", depth_max},
        {"aa_max", aa_max},
        {"samples_min", samples_min},
        {"samples_max", samples_max},
        {"error_max", static_cast<std::uint64_t>(error_max)},
        {"time_limit_max", static_cast<std::uint64_t>(time_limit_max.count())},
    };
    std::size_t on_page = 0;
    for (const auto& [name, value] : page.rows)
        on_page += name.ends_with("_max`") || name.ends_with("_min`") || name == "`chunk_bytes`";
    CHECK(on_page == limits.size());
    for (const auto& [name, value] : limits) {
        CAPTURE(name);
        const auto row = page.rows.find("`" + name + "`");
        REQUIRE(row != page.rows.end());
        CHECK(row->second == std::to_string(value));
    }
}

TEST_CASE("the page has the version and the enums of the code") {
    const Page page = read_page();
    CHECK(page.text.find("**Version " + std::to_string(version) + ".**") != std::string::npos);
    const auto check = [&](const std::string& name, unsigned count) {
        CAPTURE(name);
        const auto row = page.rows.find("`" + name + "`");
        REQUIRE(row != page.rows.end());
        const auto names = enumerators(name);
        CHECK(row->second == joined(names));
        CHECK(names.size() == count);
    };
    check("KernelChoice", ValueCount<KernelChoice>::value);
    check("PixelFilter", ValueCount<PixelFilter>::value);
    check("TileOrder", ValueCount<TileOrder>::value);
    check("JobPhase", ValueCount<JobPhase>::value);
    check("RefusalCode", ValueCount<RefusalCode>::value);
    check("FailureCode", ValueCount<FailureCode>::value);
}

TEST_CASE("the page names the roles that the code asks for") {
    const Page page = read_page();
    std::size_t rows = 0;
    for_each_message_type([&]<class M>(std::type_identity<M>) {
        CAPTURE(M::name);
        const auto row = page.rows.find("`" + std::string(M::name) + "`");
        const std::string needed = alternatives(roles_to_say(M{}));
        CHECK((row == page.rows.end() ? std::string() : row->second) == needed);
        rows += !needed.empty();
    });
    CHECK(rows == 22);
}

TEST_CASE("the page says of exactly those messages that carry blobs that they do") {
    const Page page = read_page();
    for_each_message_type([&]<class M>(std::type_identity<M>) {
        const std::string heading = std::to_string(M::type) + " " + std::string(M::name);
        CAPTURE(heading);
        const auto begin = page.text.find("### " + heading + "\n");
        REQUIRE(begin != std::string::npos);
        const std::string section =
            page.text.substr(begin, page.text.find("\n#", begin + 1) - begin);
        const bool says = section.find("lob frame") != std::string::npos;
        CHECK(says == CarriesBlobs<M>);
    });
}
