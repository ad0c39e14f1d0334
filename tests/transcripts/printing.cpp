#include "tests/transcripts/printing.hpp"

#include "common/base/text.hpp"
#include "common/base/version.hpp"
#include "common/protocol/topics.hpp"
#include "tests/transcripts/enum_names.hpp"

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <type_traits>

namespace fraja::broker {
namespace {

using namespace protocol;

/// What a client wants is told where it is not as usual; what happened is told always.
template <class T>
constexpr bool is_wish = std::is_same_v<T, Schedule> || std::is_same_v<T, TileOrder> ||
                         std::is_same_v<T, KernelChoice> || std::is_same_v<T, PixelFilter>;
template <class T>
constexpr bool is_always_told = std::is_enum_v<T> && !is_wish<T>;

std::string hex(std::span<const std::uint8_t> bytes) {
    std::string text;
    char digits[3];
    for (const std::uint8_t byte : bytes) {
        (void)std::snprintf(digits, sizeof digits, "%02x", byte);
        text += digits;
    }
    return text;
}

std::string number(double value) {
    char text[32];
    (void)std::snprintf(text, sizeof text, "%.4g", value);
    return text;
}

std::string quoted(std::string_view text) {
    if (text == fraja::version)
        return "(this one)";
    const bool plain = !text.empty() && std::ranges::all_of(text, [](unsigned char c) {
        return std::isgraph(c) && c != '"' && c != '(' && c != ')' && c != '[' && c != ']';
    });
    return plain ? std::string(text) : '"' + printable(text) + '"';
}

// ----------------------------------------------------------------------------------------- values

template <Record R>
std::string fields_of(const R& record);

template <class Tag>
std::string value_of(const Uuid<Tag>& id) {
    const bool small =
        std::all_of(id.bytes.begin(), id.bytes.end() - 1, [](auto b) { return b == 0; });
    return small ? std::to_string(id.bytes.back()) : hex(std::span(id.bytes).first(4));
}
std::string value_of(const ContentHash& hash) {
    return hex(std::span(hash.bytes).first(4));
}
std::string value_of(const std::string& text) {
    return quoted(text);
}
std::string value_of(Duration d) {
    return printed(d);
}
std::string value_of(double value) {
    return number(value);
}
std::string value_of(bool value) {
    return value ? "true" : "false";
}
std::string value_of(const Extent& size) {
    return std::to_string(size.width) + "x" + std::to_string(size.height);
}
std::string value_of(const PixelRect& r) {
    return std::to_string(r.x) + "," + std::to_string(r.y) + "," + std::to_string(r.width) + "," +
           std::to_string(r.height);
}
std::string value_of(const Bytes& bytes) {
    return std::to_string(bytes.size()) + " bytes";
}
std::string value_of(const std::vector<Blob>& blobs) {
    return std::to_string(byte_count(blobs)) + " bytes";
}
template <class T>
requires(std::is_integral_v<T> && !std::is_same_v<T, bool>) std::string value_of(T value) {
    return std::to_string(value);
}
template <class E>
requires std::is_enum_v<E> std::string value_of(E value) {
    if constexpr (Named<E>)
        return std::string(enumerators<E>.at(static_cast<std::size_t>(value)));
    else
        return std::to_string(static_cast<std::underlying_type_t<E>>(value));
}
template <Record R>
std::string value_of(const R& record) {
    const std::string fields = fields_of(record);
    return "(" + (fields.empty() ? fields : fields.substr(1)) + ")";
}
template <class T>
std::string value_of(const std::shared_ptr<T>& value) {
    return value_of(*value);
}
template <class T>
std::string value_of(const std::vector<T>& values) {
    std::string text;
    for (const T& value : values)
        text += (text.empty() ? "" : " ") + value_of(value);
    return "[" + text + "]";
}

// ----------------------------------------------------------------------------------------- fields

/// " name=value", or nothing where that is as usual.
template <class T>
std::string field(std::string_view name, const T& value,
                  const std::type_identity_t<T>& usual = {}) {
    if (!is_always_told<T> && value == usual)
        return "";
    return " " + std::string(name) + "=" + value_of(value);
}

template <Record R>
R usual_for([[maybe_unused]] const R& record) {
    R usual{};
    if constexpr (std::is_same_v<R, PictureSettings>) // all of it is drawn
        usual.crop = {0, 0, record.size.width, record.size.height};
    return usual;
}

template <Record R>
std::string fields_of(const R& record) {
    const R usual = usual_for(record);
    std::string text;
    std::apply(
        [&](const auto&... f) {
            ((text += field(f.name, record.*(f.member), usual.*(f.member))), ...);
        },
        FieldsOf<R>::fields());
    if constexpr (CarriesBlobs<R>)
        text += field("blobs", record.blobs);
    return text;
}

std::string told(const Message& message) {
    return std::visit([](const auto& m) { return std::string(m.name) + fields_of(m); }, message);
}

std::string topic_name(const std::string& topic) {
    if (const auto job = topic_id<JobId>('J', topic))
        return "J" + value_of(*job);
    if (const auto nonce = topic_id<Nonce>('N', topic))
        return "N" + value_of(*nonce);
    return topic;
}

// ---------------------------------------------------------------------------------------- actions
// These have no list of their fields, so each is taken apart: a new field is told, or nothing
// compiles.

std::string told(const PutBlob& write) {
    const auto& [hash, pieces] = write;
    return "PutBlob" + field("hash", hash) + field("pieces", pieces);
}
std::string told(const PutJob& write) {
    const auto& [submission, job_number, passes, revision, phase] = write;
    return "PutJob" + field("number", job_number) + field("passes", passes, 1) +
           field("revision", revision.counter) + field("phase", phase, JobPhase{}) +
           fields_of(submission);
}
std::string told(const PutTile& write) {
    const auto& [tile] = write;
    return "PutTile" + fields_of(*tile);
}
std::string told(const PutPhase& write) {
    const auto& [job, phase, reason, elapsed, revision, checks] = write;
    return "PutPhase" + field("job", job) + field("phase", phase) + field("reason", reason) +
           field("elapsed", elapsed) + field("revision", revision.counter) +
           field("agreed", checks.agreed) + field("unchecked", checks.unchecked);
}
std::string told(const PutDistrusted& write) {
    const auto& [job, worker, tiles, revision] = write;
    return "PutDistrusted" + field("job", job) + fields_of(worker) + field("tiles", tiles.size()) +
           field("revision", revision.counter);
}
std::string told(const PutTrusted& write) {
    return "PutTrusted" + field("job", write.job) + field("worker", write.worker);
}
std::string told(const PutPriority& write) {
    const auto& [job, priority, revision] = write;
    return "PutPriority" + field("job", job) + field("priority", priority) +
           field("revision", revision.counter);
}
std::string told(const PutTerm& write) {
    return "PutTerm" + field("counter", write.counter);
}
std::string told(const PutNumber& write) {
    const auto& [job, job_number, revision] = write;
    return "PutNumber" + field("job", job) + field("number", job_number) +
           field("revision", revision.counter);
}
std::string told(const ForgetJob& write) {
    const auto& [job, may_come_back] = write;
    return "ForgetJob" + field("job", job) + field("may_come_back", may_come_back);
}

std::string in_older(protocol::Version version) {
    return version == protocol::version ? "" : field("version", version);
}

std::string told(const Send& action) {
    const auto& [peer, message, version] = action;
    return "send " + peer + " " + told(message) + in_older(version);
}
std::string told(const Dial& action) {
    const auto& [endpoint] = action;
    return "dial " + endpoint;
}
std::string told(const HangUp& action) {
    const auto& [endpoint] = action;
    return "hang_up " + endpoint;
}
std::string told(const Tell& action) {
    const auto& [endpoint, message] = action;
    return "tell " + endpoint + " " + told(message);
}
std::string told(const Publish& action) {
    const auto& [topic, message] = action;
    return "publish " + topic_name(topic) + " " + told(message);
}
std::string told(const Persist& action) {
    const auto& [sequence, write] = action;
    return "persist " + std::to_string(sequence) + " " +
           std::visit([](const auto& w) { return told(w); }, write);
}
std::string told(const SendStored& action) {
    const auto& [peer, job, tiles, epoch, version] = action;
    return "send_stored " + peer + field("job", job) + field("tiles", tiles) +
           field("epoch", epoch) + in_older(version);
}
std::string told(const LoadScene& action) {
    const auto& [job, scene, peer] = action;
    return "load_scene" + field("job", job) + field("scene", scene) + field("peer", peer);
}
std::string told(const OrderFilled& action) {
    const auto& [id, parts, probe, rays, render_time] = action;
    return "order_filled" + field("id", id) + field("parts", parts) + field("probe", probe) +
           field("rays", rays) + field("render_time", render_time);
}
std::string told(const OrderFailed& action) {
    const auto& [id, code, reason] = action;
    return "order_failed" + field("id", id) + field("code", code) + field("reason", reason);
}
std::string told(const Log& action) {
    return "log " + value_of(action.level) + " " + printable(action.text);
}

} // namespace

std::string printed(Duration d) {
    const auto count = static_cast<std::uint64_t>(d.count());
    const std::uint64_t ns = d < Duration::zero() ? 0 - count : count;
    const bool is_small = ns > 0 && ns < 1'000'000'000;
    const std::uint64_t unit = is_small ? 1'000'000 : 1'000'000'000;
    std::string text = (d < Duration::zero() ? "-" : "") + std::to_string(ns / unit);
    if (ns % unit > 0) {
        const std::string part = std::to_string(unit + ns % unit); // with its zeros, after a 1
        text += "." + part.substr(1, part.find_last_not_of('0'));
    }
    return text + (is_small ? "ms" : "s");
}

std::string printed(const Action& action) {
    return std::visit([](const auto& a) { return told(a); }, action);
}

} // namespace fraja::broker
