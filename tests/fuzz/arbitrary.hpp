// Messages out of a fuzzer's bytes: every type there is, field by field, by the types of the
// fields. A message or a field that the protocol gains is fuzzed without a word here.
//
// They are what decode() lets through, and no more: cores need not stand anything else. Ids, hashes
// and names come from a handful, so that messages are about one another.
#pragma once

#include "common/protocol/content_hash.hpp"
#include "common/protocol/limits.hpp"
#include "common/protocol/messages.hpp"
#include "tests/fuzz/input.hpp"
#include "tests/support/messages.hpp"

#include <array>
#include <chrono>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

namespace fraja::fuzz {

inline constexpr std::uint32_t ids = 4;    ///< of each kind
inline constexpr std::uint32_t scenes = 3; ///< whose text is known

/// Never the zero id, but where the input says so.
template <class Id>
[[nodiscard]] Id id_of(std::uint32_t number) {
    Id id;
    id.bytes[0] = static_cast<std::uint8_t>(number);
    return id;
}

/// A scene whose text is known.
struct KnownScene {
    Blob text;
    ContentHash hash;
    std::vector<protocol::Chunk> chunks;
};

[[nodiscard]] inline KnownScene known_scene(std::size_t text_bytes) {
    KnownScene scene{.text = Blob(Bytes(text_bytes, std::byte{'s'})), .hash = {}, .chunks = {}};
    scene.hash = protocol::content_hash(scene.text);
    for (std::size_t at = 0; at < text_bytes; at += protocol::chunk_bytes) {
        protocol::Chunk& chunk = scene.chunks.emplace_back();
        chunk.blob = scene.hash;
        chunk.offset_bytes = at;
        chunk.total_bytes = text_bytes;
        chunk.blobs = {
            Blob(Bytes(std::min(protocol::chunk_bytes, text_bytes - at), std::byte{'s'}))};
    }
    return scene;
}

/// Of one byte, of several, of two chunks.
[[nodiscard]] inline const std::array<KnownScene, scenes>& known_scenes() {
    static const std::array<KnownScene, scenes> all = {known_scene(1), known_scene(700),
                                                       known_scene(protocol::chunk_bytes + 9)};
    return all;
}
/// One of them; rarely the large one, which takes time.
[[nodiscard]] inline const KnownScene& any_scene(Input& in) {
    return known_scenes()[in.once_in(16) ? 2 : in.below(2)];
}

/// The chunk that a NeedChunk asks for, of a scene whose text is known.
[[nodiscard]] inline std::optional<protocol::Chunk> chunk_for(const protocol::NeedChunk& need) {
    for (const KnownScene& scene : known_scenes())
        for (const protocol::Chunk& chunk : scene.chunks)
            if (scene.hash == need.blob && chunk.offset_bytes == need.offset_bytes)
                return chunk;
    return std::nullopt;
}

template <class T>
void fill(Input& in, T& value);

/// A small picture that can be drawn.
[[nodiscard]] inline protocol::PictureSettings small_picture(Input& in) {
    protocol::PictureSettings s;
    s.size = {1 + in.below(24), 1 + in.below(24)};
    s.crop = {0, 0, s.size.width, s.size.height};
    if (in.once_in(4)) {
        s.crop.x = in.below(s.size.width);
        s.crop.y = in.below(s.size.height);
        s.crop.width = 1 + in.below(s.size.width - s.crop.x);
        s.crop.height = 1 + in.below(s.size.height - s.crop.y);
    }
    switch (in.below(8)) {
    case 1:
        s.spp = 4;
        break;
    case 2:
        s.error = 1;
        break;
    case 3:
        s.time_limit = std::chrono::milliseconds(1 + in.below(20'000));
        s.max_samples = 4u << in.below(4);
        break;
    }
    return s;
}

/// Any value that a decoder may give.
template <class T>
void fill(Input& in, T& value) {
    if constexpr (std::is_same_v<T, bool>) {
        value = in.below(2) == 1;
    } else if constexpr (std::is_same_v<T, double>) {
        value = in.below(2) == 0 ? in.below(256) / 8.0 : static_cast<double>(in.any_number());
    } else if constexpr (std::is_same_v<T, Duration>) {
        const auto count = static_cast<Duration::rep>(in.any_number());
        value =
            in.below(2) == 0 ? Duration(count) : Duration(std::chrono::milliseconds(in.number(2)));
    } else if constexpr (requires { protocol::ValueCount<T>::value; }) {
        value = static_cast<T>(in.below(protocol::ValueCount<T>::value));
    } else if constexpr (std::is_enum_v<T> || std::is_integral_v<T>) {
        value = static_cast<T>(in.any_number());
    } else if constexpr (std::is_same_v<T, std::string>) {
        constexpr std::string_view names[] = {"", "a", "b", "#1", "#2", "00000000", "tcp://*:1"};
        const std::uint32_t kind = in.below(32);
        if (kind < 20)
            value = names[kind % std::size(names)];
        else if (kind < 31)
            value = in.text(in.below(16));
        else // at the limits, and within a character
            value = std::string(protocol::string_bytes_max - in.below(8), 'x') + "\xc3\xa4";
        value.resize(std::min(value.size(), protocol::string_bytes_max));
    } else if constexpr (std::is_same_v<T, ContentHash>) {
        value = in.once_in(8) ? id_of<ContentHash>(in.byte()) : any_scene(in).hash;
    } else if constexpr (requires { value.bytes.data(); }) {
        value = id_of<T>(in.once_in(32) ? 0 : 1 + in.below(ids));
    } else if constexpr (std::is_same_v<T, Bytes>) {
        value = in.bytes(in.below(40));
    } else if constexpr (fraja::detail::is_vector_v<T>) {
        value.resize(in.once_in(64) ? 70 : in.below(4));
        for (auto& element : value)
            fill(in, element);
    } else if constexpr (std::is_same_v<T, protocol::Rays>) {
        value = {.camera = in.byte()};
        if (in.once_in(4))
            std::apply([&](const auto&... f) { (fill(in, value.*f.member), ...); }, T::fields());
    } else if constexpr (std::is_same_v<T, protocol::PictureSettings>) {
        value = small_picture(in);
        if (in.once_in(8)) // or any field of it anything
            std::apply(
                [&](const auto&... f) {
                    ((in.once_in(4) ? fill(in, value.*f.member) : void()), ...);
                },
                T::fields());
    } else {
        std::apply([&](const auto&... f) { (fill(in, value.*f.member), ...); },
                   protocol::FieldsOf<T>::fields());
    }
}

template <class M>
[[nodiscard]] M message_of(Input& in) {
    M message;
    fill(in, message);
    if constexpr (protocol::CarriesBlobs<M>) {
        const std::uint32_t count = std::is_same_v<M, protocol::Chunk> ? 1 : 1 + in.below(3);
        for (std::uint32_t i = 0; i < count; ++i)
            message.blobs.push_back(Blob(Bytes(in.below(100), std::byte{7})));
    }
    return message;
}

/// A message of any type.
[[nodiscard]] inline protocol::Message any_message(Input& in) {
    protocol::Message message;
    std::size_t at = in.below(std::variant_size_v<protocol::MessageVariant>);
    for_each_message_type([&]<class M>(std::type_identity<M>) {
        if (at-- == 0)
            message = message_of<M>(in);
    });
    return message;
}

/// Copies every field that both have, by name and type: so an answer is made of its question.
template <class To, class From>
void copy_common(To& to, const From& from) {
    const auto copy = [&](const auto& target, const auto& source) {
        if constexpr (std::is_same_v<std::decay_t<decltype(to.*target.member)>,
                                     std::decay_t<decltype(from.*source.member)>>)
            if (target.name == source.name)
                to.*target.member = from.*source.member;
    };
    const auto find = [&](const auto& target) {
        std::apply([&](const auto&... source) { (copy(target, source), ...); }, From::fields());
    };
    std::apply([&](const auto&... target) { (find(target), ...); }, To::fields());
}
/// `message`, as an answer to `question`.
template <class To, class From>
[[nodiscard]] To answer_to(const From& question, To message = {}) {
    copy_common(message, question);
    return message;
}

/// In which a refusal says that it was not understood: some are of the version before.
[[nodiscard]] inline protocol::Version version_of(const protocol::Message& message) {
    const auto* refused = std::get_if<protocol::Refused>(&message);
    return refused && refused->code == protocol::RefusalCode::version_mismatch &&
                   refused->reason.size() % 2 == 1
               ? protocol::oldest_version_spoken
               : protocol::version;
}

/// So many bytes of pixels, in one or two frames.
[[nodiscard]] inline std::vector<Blob> pixels(std::uint64_t bytes, Input& in) {
    const std::uint64_t first = in.once_in(4) ? bytes / 2 : bytes;
    std::vector<Blob> blobs = {Blob(Bytes(first, std::byte{1}))};
    if (first < bytes)
        blobs.push_back(Blob(Bytes(bytes - first, std::byte{2})));
    return blobs;
}

/// Mostly less than what is waited for, sometimes a minute; never so much that a clock ran over.
[[nodiscard]] inline Duration time_step(Input& in) {
    using namespace std::chrono_literals;
    constexpr Duration steps[] = {0s, 1ms, 100ms, 500ms, 1s, 3s, 10s, 61s, 3600s};
    return steps[in.below(std::size(steps))] + Duration(in.below(2));
}

} // namespace fraja::fuzz
