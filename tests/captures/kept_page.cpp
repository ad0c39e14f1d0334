#include "tests/captures/kept_page.hpp"

#include "tests/captures/capture.hpp"

#include <algorithm>
#include <doctest/doctest.h>
#include <fstream>
#include <msgpack.hpp>
#include <regex>
#include <sstream>
#include <stdexcept>

namespace fraja {
namespace {

struct Objection : std::runtime_error {
    using std::runtime_error::runtime_error;
};

void demand(bool holds, const std::string& what) {
    if (!holds)
        throw Objection(what);
}

const msgpack::object& object_of(const void* object) {
    return *static_cast<const msgpack::object*>(object);
}

std::uint64_t unsigned_of(const void* object) {
    demand(object_of(object).type == msgpack::type::POSITIVE_INTEGER, "not an unsigned integer");
    return object_of(object).via.u64;
}

} // namespace

KeptPage::KeptPage(unsigned version) : version_(version) {
    std::ifstream in(captures / std::to_string(version) / "PROTOCOL.md");
    REQUIRE(in.good());
    const std::regex message("### ([0-9]+) ([A-Za-z]+)"), record("### ([A-Za-z]+)"),
        field(R"(\| ([a-z_0-9]+) \| ([A-Za-z0-9\[\]]+) \|.*)"),
        enumeration(R"(\| `([A-Z][A-Za-z]+)` \| ([a-z_, ]+) \|)");
    std::string section;
    for (std::string line; std::getline(in, line);) {
        std::smatch found;
        if (std::regex_match(line, found, message))
            records_[messages_[static_cast<unsigned>(std::stoul(found[1]))] = section = found[2]];
        else if (std::regex_match(line, found, record))
            section = found[1];
        else if (line.starts_with("#"))
            section.clear();
        else if (std::regex_match(line, found, enumeration))
            enums_[found[1]] = 1 + static_cast<std::uint64_t>(std::ranges::count(line, ','));
        else if (!section.empty() && line != "| field | type | meaning |" &&
                 std::regex_match(line, found, field))
            records_[section].push_back({found[1], found[2]});
    }
    REQUIRE(messages_.size() > 20);
    REQUIRE(enums_.size() == 9);
}

std::string KeptPage::complaint(std::span<const Blob> frames) const {
    try {
        demand(frames.size() >= 2, "fewer than two frames");
        const auto byte = [&](std::size_t i) {
            return std::to_integer<unsigned>(frames[0].data()[i]);
        };
        demand(frames[0].size() == 8 && byte(0) == 'F' && byte(1) == 'R' && byte(2) == 'J' &&
                   byte(3) == 'A',
               "no header");
        demand(byte(4) + 256 * byte(5) == version_, "another version");
        const auto found = messages_.find(byte(6) + 256 * byte(7));
        demand(found != messages_.end(), "an unknown message");
        const auto* body = reinterpret_cast<const char*>(frames[1].data());
        std::size_t offset = 0;
        const auto handle = msgpack::unpack(body, frames[1].size(), offset);
        demand(offset == frames[1].size(), "bytes behind the body");
        try {
            check_fields(records_.at(found->second), &handle.get());
        } catch (const std::exception& e) {
            throw Objection(found->second + ": " + e.what());
        }
        return {};
    } catch (const std::exception& e) {
        return e.what();
    }
}

std::optional<std::vector<Blob>> KeptPage::trimmed(std::span<const Blob> frames, Trim trim) const {
    const auto type = std::to_integer<unsigned>(frames[0].data()[6]);
    const Fields& fields = records_.at(messages_.at(type));
    const std::size_t left_out = trim == Trim::one_field_less ? 1 : 0;
    if (fields.size() < left_out)
        return std::nullopt;
    const auto handle =
        msgpack::unpack(reinterpret_cast<const char*>(frames[1].data()), frames[1].size());
    msgpack::sbuffer out;
    msgpack::packer<msgpack::sbuffer> packer(out);
    copy_fields(packer, fields, fields.size() - left_out, &handle.get());
    Bytes header(frames[0].begin(), frames[0].end());
    header[4] = static_cast<std::byte>(version_);
    const auto* body = reinterpret_cast<const std::byte*>(out.data());
    std::vector<Blob> result{Blob(std::move(header)), Blob(Bytes(body, body + out.size()))};
    result.insert(result.end(), frames.begin() + 2, frames.end());
    return result;
}

template <class Packer>
void KeptPage::copy_fields(Packer& packer, const Fields& fields, std::size_t count,
                           const void* object) const {
    packer.pack_array(static_cast<std::uint32_t>(count));
    for (std::size_t i = 0; i < count; ++i)
        copy(packer, fields[i].type, &object_of(object).via.array.ptr[i]);
}

template <class Packer>
void KeptPage::copy(Packer& packer, const std::string& type, const void* object) const {
    const msgpack::object& o = object_of(object);
    if (type.starts_with('[')) {
        packer.pack_array(o.via.array.size);
        for (std::uint32_t i = 0; i < o.via.array.size; ++i)
            copy(packer, type.substr(1, type.size() - 2), &o.via.array.ptr[i]);
    } else if (const auto record = records_.find(type); record != records_.end()) {
        copy_fields(packer, record->second, record->second.size(), object);
    } else {
        packer.pack(o);
    }
}

/// Further fields at the end are ignored.
void KeptPage::check_fields(const Fields& fields, const void* object) const {
    const msgpack::object& o = object_of(object);
    demand(o.type == msgpack::type::ARRAY, "not an array");
    for (std::size_t i = 0; i < fields.size(); ++i) {
        demand(i < o.via.array.size, fields[i].name + " is missing");
        try {
            check(fields[i].type, &o.via.array.ptr[i]);
        } catch (const std::exception& e) {
            throw Objection(fields[i].name + ": " + e.what());
        }
    }
}

void KeptPage::check(const std::string& type, const void* object) const {
    using namespace msgpack::type;
    const msgpack::object& o = object_of(object);
    const auto is_bytes = [&](std::uint32_t size) {
        return o.type == BIN && o.via.bin.size == size;
    };
    const bool is_integer = o.type == POSITIVE_INTEGER || o.type == NEGATIVE_INTEGER;
    if (type.starts_with('[')) {
        demand(o.type == ARRAY, "not an array");
        for (std::uint32_t i = 0; i < o.via.array.size; ++i)
            check(type.substr(1, type.size() - 2), &o.via.array.ptr[i]);
    } else if (const auto record = records_.find(type); record != records_.end()) {
        check_fields(record->second, object);
    } else if (const auto values = enums_.find(type); values != enums_.end()) {
        demand(unsigned_of(object) < values->second, "an unknown value");
    } else if (type == "bool") {
        demand(o.type == BOOLEAN, "no bool");
    } else if (type == "str") {
        demand(o.type == STR, "no str");
    } else if (type == "bytes") {
        demand(o.type == BIN, "no bytes");
    } else if (type == "f64") {
        demand(o.type == FLOAT64 || is_integer, "no f64");
    } else if (type == "uuid") {
        demand(is_bytes(16), "no uuid");
    } else if (type == "hash") {
        demand(is_bytes(32), "no hash");
    } else if (type == "ns") {
        demand(is_integer, "no ns");
    } else if (type == "i32") {
        demand(is_integer &&
                   (o.type == NEGATIVE_INTEGER ? o.via.i64 >= INT32_MIN : o.via.u64 <= INT32_MAX),
               "no i32");
    } else {
        demand(type.starts_with('u'), "the page has an unknown type " + type);
        const unsigned bits = static_cast<unsigned>(std::stoul(type.substr(1)));
        demand(bits == 64 || unsigned_of(object) >> bits == 0, "no " + type);
        (void)unsigned_of(object);
    }
}

} // namespace fraja
