#include "common/protocol/codec.hpp"

#include "common/base/assert.hpp"
#include "common/protocol/limits.hpp"

#include <cmath>
#include <cstring>
#include <limits>
#include <msgpack.hpp>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>

namespace fraja::protocol {
namespace {

constexpr char magic[4] = {'F', 'R', 'J', 'A'};
constexpr std::size_t header_bytes = 8; // magic, version, type: little endian
// Most messages need no more at once.
constexpr std::size_t zone_bytes = 512, body_bytes = 256;

/// Thrown and caught in this file: what a decoder found, with the field's name.
struct Malformed : std::runtime_error {
    using std::runtime_error::runtime_error;
};

template <class T>
concept ByteArray = requires(T t) {
    { t.bytes.data() } -> std::same_as<std::uint8_t*>;
};
template <class T>
constexpr bool is_vector = false;
template <class T>
constexpr bool is_vector<std::vector<T>> = true;

// ---------------------------------------------------------------------------------------- writing

struct BytesWriter {
    Bytes& out;
    void write(const char* data, std::size_t size) {
        const auto* begin = reinterpret_cast<const std::byte*>(data);
        out.insert(out.end(), begin, begin + size);
    }
};
struct Packer : msgpack::packer<BytesWriter> {
    Packer(BytesWriter& writer, Version spoken_) : packer(writer), spoken(spoken_) {}
    Version spoken; ///< by whoever shall read it
};

std::uint32_t checked_size(std::size_t size) {
    FRAJA_ASSERT(size <= frame_bytes_max);
    return static_cast<std::uint32_t>(size);
}

template <class T>
void pack(Packer& packer, const T& value) {
    if constexpr (std::is_same_v<T, bool> || std::is_same_v<T, double>) {
        packer.pack(value);
    } else if constexpr (std::is_same_v<T, Duration>) {
        packer.pack_int64(value.count());
    } else if constexpr (std::is_enum_v<T>) {
        T said = value;
        if constexpr (requires { ValueCount<T>::in_words_of(packer.spoken, value); })
            said = ValueCount<T>::in_words_of(packer.spoken, value);
        packer.pack_uint64(static_cast<std::uint64_t>(said));
    } else if constexpr (std::is_unsigned_v<T>) {
        packer.pack_uint64(value);
    } else if constexpr (std::is_signed_v<T>) {
        packer.pack_int64(value);
    } else if constexpr (std::is_same_v<T, std::string>) {
        FRAJA_ASSERT(value.size() <= string_bytes_max);
        packer.pack_str(checked_size(value.size()));
        packer.pack_str_body(value.data(), checked_size(value.size()));
    } else if constexpr (ByteArray<T>) {
        packer.pack_bin(checked_size(value.bytes.size()));
        packer.pack_bin_body(reinterpret_cast<const char*>(value.bytes.data()),
                             checked_size(value.bytes.size()));
    } else if constexpr (std::is_same_v<T, Bytes>) {
        packer.pack_bin(checked_size(value.size()));
        packer.pack_bin_body(reinterpret_cast<const char*>(value.data()),
                             checked_size(value.size()));
    } else if constexpr (is_vector<T>) {
        packer.pack_array(checked_size(value.size()));
        for (const auto& element : value)
            pack(packer, element);
    } else {
        static_assert(Record<T>);
        std::apply(
            [&](const auto&... field) {
                packer.pack_array(sizeof...(field));
                (pack(packer, value.*(field.member)), ...);
            },
            FieldsOf<T>::fields());
    }
}

// ---------------------------------------------------------------------------------------- reading

template <class T>
T narrow(std::uint64_t value) {
    if (value > static_cast<std::uint64_t>(std::numeric_limits<T>::max()))
        throw Malformed("a number that is too large");
    return static_cast<T>(value);
}

std::uint64_t unsigned_of(const msgpack::object& o) {
    if (o.type != msgpack::type::POSITIVE_INTEGER)
        throw Malformed("not an unsigned integer");
    return o.via.u64;
}

template <class T>
T signed_of(const msgpack::object& o) {
    if (o.type == msgpack::type::POSITIVE_INTEGER)
        return narrow<T>(o.via.u64);
    if (o.type != msgpack::type::NEGATIVE_INTEGER)
        throw Malformed("not an integer");
    if (o.via.i64 < std::numeric_limits<T>::min())
        throw Malformed("a number that is too small");
    return static_cast<T>(o.via.i64);
}

/// What was kept may have been written by every version that there ever was.
constexpr Version any_version = 0;

/// Where a reader is, and how it reads.
struct Reading {
    Version written_by = version;
    std::string_view field{}; ///< the name of what is being read, for the message of an error

    [[nodiscard]] bool may_miss(Version since) const {
        return written_by == any_version || since > written_by;
    }
};

template <class T>
void unpack(const msgpack::object& o, T& value, Reading& reading);

template <class T>
void unpack_record(const msgpack::object& o, T& value, Reading& reading) {
    if (o.type != msgpack::type::ARRAY)
        throw Malformed("not an array");
    std::size_t at = 0;
    const auto read = [&](const auto& field) {
        reading.field = field.name;
        if (at < o.via.array.size)
            unpack(o.via.array.ptr[at++], value.*(field.member), reading);
        else if (!reading.may_miss(field.since))
            throw Malformed("missing");
    };
    std::apply([&](const auto&... field) { (read(field), ...); }, FieldsOf<T>::fields());
}

template <class T>
void unpack(const msgpack::object& o, T& value, [[maybe_unused]] Reading& reading) {
    if constexpr (std::is_same_v<T, bool>) {
        if (o.type != msgpack::type::BOOLEAN)
            throw Malformed("not a boolean");
        value = o.via.boolean;
    } else if constexpr (std::is_same_v<T, double>) {
        if (o.type == msgpack::type::FLOAT64 && std::isfinite(o.via.f64))
            value = o.via.f64;
        else if (o.type == msgpack::type::POSITIVE_INTEGER) // so msgpack packs 0.0
            value = static_cast<double>(o.via.u64);
        else if (o.type == msgpack::type::NEGATIVE_INTEGER)
            value = static_cast<double>(o.via.i64);
        else
            throw Malformed("not a finite number");
    } else if constexpr (std::is_same_v<T, Duration>) {
        value = Duration(signed_of<Duration::rep>(o));
    } else if constexpr (std::is_enum_v<T>) {
        using Underlying = std::underlying_type_t<T>;
        const auto number = narrow<Underlying>(unsigned_of(o));
        if constexpr (requires { ValueCount<T>::value; })
            if (number >= ValueCount<T>::value)
                throw Malformed("an unknown value " + std::to_string(number));
        value = T{number};
    } else if constexpr (std::is_unsigned_v<T>) {
        value = narrow<T>(unsigned_of(o));
    } else if constexpr (std::is_signed_v<T>) {
        value = signed_of<T>(o);
    } else if constexpr (std::is_same_v<T, std::string>) {
        if (o.type != msgpack::type::STR || o.via.str.size > string_bytes_max)
            throw Malformed("not a string of at most " + std::to_string(string_bytes_max) +
                            " bytes");
        value.assign(o.via.str.ptr, o.via.str.size);
    } else if constexpr (ByteArray<T>) {
        if (o.type != msgpack::type::BIN || o.via.bin.size != value.bytes.size())
            throw Malformed("not " + std::to_string(value.bytes.size()) + " bytes");
        std::memcpy(value.bytes.data(), o.via.bin.ptr, value.bytes.size());
    } else if constexpr (std::is_same_v<T, Bytes>) {
        if (o.type != msgpack::type::BIN)
            throw Malformed("not bytes");
        const auto* begin = reinterpret_cast<const std::byte*>(o.via.bin.ptr);
        value.assign(begin, begin + o.via.bin.size);
    } else if constexpr (is_vector<T>) {
        if (o.type != msgpack::type::ARRAY)
            throw Malformed("not an array");
        value.clear();
        for (std::uint32_t i = 0; i < o.via.array.size; ++i)
            unpack(o.via.array.ptr[i], value.emplace_back(), reading);
    } else {
        static_assert(Record<T>);
        unpack_record(o, value, reading);
    }
}

Error malformed(std::string_view what, std::string_view why) {
    return {ErrorCode::malformed_frame, std::string(what) + ": " + std::string(why)};
}

template <class M>
Result<M> read_body(std::span<const std::byte> body, Version written_by) {
    const std::size_t n = body.size();
    // Nothing in a frame can outnumber its bytes. Without limits, the five bytes DD FF FF FF FF
    // make msgpack ask for 128 GiB before it looks any further.
    const msgpack::unpack_limit limit(n, n, n, n, n, nesting_max);
    M message;
    Reading reading{written_by};
    try {
        std::size_t offset = 0;
        // By default a zone begins with 8 KiB, and has copies of all strings.
        msgpack::zone zone(zone_bytes);
        const auto object = msgpack::unpack(
            zone, reinterpret_cast<const char*>(body.data()), n, offset,
            [](msgpack::type::object_type, std::size_t, void*) { return true; }, nullptr, limit);
        if (offset != n)
            return malformed(M::name, "bytes after the end of the body");
        unpack_record(object, message, reading);
    } catch (const std::exception& e) { // msgpack speaks in exceptions; here they end
        return malformed(M::name, std::string(reading.field) + ": " + e.what());
    }
    return message;
}

template <class M>
Result<Message> decode_as(Version written_by, std::span<const Blob> frames) {
    if (written_by < since<M>)
        return malformed("header", std::string(M::name) + " came with version " +
                                       std::to_string(since<M>) + ", not with " +
                                       std::to_string(written_by));
    auto message = read_body<M>(frames[1], written_by);
    if (!message)
        return message.error();
    const auto blobs = frames.subspan(2);
    if constexpr (CarriesBlobs<M>) {
        if (blobs.empty() || (std::is_same_v<M, Chunk> && blobs.size() != 1))
            return malformed(M::name, "a wrong number of blob frames");
        message->blobs.assign(blobs.begin(), blobs.end());
    } else if (!blobs.empty()) {
        return malformed(M::name, "blob frames where none belong");
    }
    return Message(std::move(*message));
}

template <std::size_t... I>
Result<Message> decode_type(Version written_by, std::uint16_t type, std::span<const Blob> frames,
                            std::index_sequence<I...>) {
    std::optional<Result<Message>> decoded;
    const bool known = ((std::variant_alternative_t<I, MessageVariant>::type == type &&
                         (decoded.emplace(decode_as<std::variant_alternative_t<I, MessageVariant>>(
                              written_by, frames)),
                          true)) ||
                        ...);
    if (!known)
        return malformed("header", "unknown message type " + std::to_string(type));
    return std::move(*decoded);
}

std::uint16_t little_endian(const std::byte* bytes) {
    return static_cast<std::uint16_t>(std::to_integer<unsigned>(bytes[0]) |
                                      std::to_integer<unsigned>(bytes[1]) << 8);
}

Bytes encode_header(Version spoken, std::uint16_t type) {
    Bytes header(header_bytes);
    std::memcpy(header.data(), magic, sizeof magic);
    header[4] = std::byte(spoken & 0xff);
    header[5] = std::byte(spoken >> 8);
    header[6] = std::byte(type & 0xff);
    header[7] = std::byte(type >> 8);
    return header;
}

/// For people, who can do something about it.
Error wrong_version(Version peer_version) {
    return {ErrorCode::version_mismatch,
            "the peer speaks protocol version " + std::to_string(peer_version) +
                ", this program versions " + std::to_string(oldest_version_spoken) + " and " +
                std::to_string(version) + ": " +
                (peer_version < version ? "the peer is too old, and must be updated"
                                        : "this program is too old, and must be updated")};
}

} // namespace

Packet encode(const Message& message, Version spoken) {
    FRAJA_ASSERT(is_spoken(spoken) && is_known_to(spoken, message));
    return std::visit(
        [&](const auto& m) {
            Packet packet{encode_header(spoken, m.type), {}, {}};
            packet.body.reserve(body_bytes);
            BytesWriter writer{packet.body};
            Packer packer(writer, spoken);
            pack(packer, m);
            FRAJA_ASSERT(packet.body.size() <= frame_bytes_max);
            if constexpr (CarriesBlobs<std::decay_t<decltype(m)>>) {
                FRAJA_ASSERT(!m.blobs.empty() && m.blobs.size() + 2 <= message_frames_max);
                for (const Blob& blob : m.blobs)
                    FRAJA_ASSERT(blob.size() <= frame_bytes_max);
                packet.blobs = m.blobs;
            }
            return packet;
        },
        message);
}

std::optional<Version> version_of(std::span<const Blob> frames) {
    if (frames.empty() || frames[0].size() < header_bytes ||
        std::memcmp(frames[0].data(), magic, sizeof magic) != 0)
        return std::nullopt;
    return little_endian(frames[0].data() + 4);
}

Result<Message> decode(std::span<const Blob> frames) {
    if (frames.empty())
        return malformed("message", "no frame");
    const auto written_by = version_of(frames);
    if (!written_by)
        return malformed("header", "no Fraja header");
    if (!is_spoken(*written_by))
        return wrong_version(*written_by);
    const Blob& header = frames[0];
    if (header.size() != header_bytes)
        return malformed("header", "a wrong length");
    if (frames.size() < 2)
        return malformed("message", "fewer than two frames");
    if (frames.size() > message_frames_max)
        return malformed("message", "more than " + std::to_string(message_frames_max) + " frames");
    for (const Blob& frame : frames)
        if (frame.size() > frame_bytes_max)
            return malformed("message",
                             "a frame of more than " + std::to_string(frame_bytes_max) + " bytes");
    return decode_type(*written_by, little_endian(header.data() + 6), frames,
                       std::make_index_sequence<std::variant_size_v<MessageVariant>>());
}

template <class M>
Result<M> decode_kept(std::span<const std::byte> body) {
    return read_body<M>(body, any_version);
}
template Result<SubmitJob> decode_kept<SubmitJob>(std::span<const std::byte> body);
template Result<TileDone> decode_kept<TileDone>(std::span<const std::byte> body);

} // namespace fraja::protocol
