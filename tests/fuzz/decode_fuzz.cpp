// Everything that reads bytes or text of others: the decoder, and the parsers of what people type.
#include "client/frames.hpp"
#include "client/watch_options.hpp"
#include "common/base/assert.hpp"
#include "common/base/ids.hpp"
#include "common/base/text.hpp"
#include "common/net/endpoint.hpp"
#include "common/protocol/bitmap.hpp"
#include "common/protocol/codec.hpp"
#include "common/protocol/packing.hpp"
#include "common/protocol/passes.hpp"
#include "common/protocol/topics.hpp"
#include "tests/fuzz/arbitrary.hpp"
#include "worker/options.hpp"

#include <algorithm>

using namespace fraja;
using namespace fraja::fuzz;

namespace {

std::vector<Blob> frames_of(const protocol::Packet& packet) {
    std::vector<Blob> frames = {Blob(packet.header), Blob(packet.body)};
    frames.insert(frames.end(), packet.blobs.begin(), packet.blobs.end());
    return frames;
}

bool same_bytes(const protocol::Packet& a, const protocol::Packet& b) {
    return a.header == b.header && a.body == b.body && a.blobs == b.blobs;
}

/// What decodes is encoded, and that decodes to what is encoded to the same bytes.
void check_decoding(const std::vector<Blob>& frames) {
    const auto message = protocol::decode(frames);
    if (!message) {
        FRAJA_ASSERT(!message.error().message.empty());
        return;
    }
    const protocol::Packet once = protocol::encode(*message);
    const auto again = protocol::decode(frames_of(once));
    FRAJA_ASSERT(again.has_value() && again->index() == message->index());
    FRAJA_ASSERT(same_bytes(once, protocol::encode(*again)));
    if (!is_known_to(protocol::oldest_version_spoken, *message))
        return;
    const auto older =
        protocol::decode(frames_of(protocol::encode(*message, protocol::oldest_version_spoken)));
    FRAJA_ASSERT(older.has_value() && older->index() == message->index());
}

/// A body that lay in a store: what is read is written, and that reads to the same bytes.
template <class M>
void check_kept(std::span<const std::byte> body) {
    auto kept = protocol::decode_kept<M>(body);
    if (!kept) {
        FRAJA_ASSERT(!kept.error().message.empty());
        return;
    }
    const auto body_of = [](M& message) {
        if constexpr (std::is_same_v<M, protocol::TileDone>)
            message.blobs = {Blob()}; // they lie elsewhere
        return protocol::encode(message).body;
    };
    const Bytes once = body_of(*kept);
    auto again = protocol::decode_kept<M>(once);
    FRAJA_ASSERT(again.has_value() && body_of(*again) == once);
}

/// What a session receives: bytes, in which frames may be packed.
void decode_packed(const Blob& packed) {
    const std::vector<Blob> frames = protocol::unpack(packed);
    FRAJA_ASSERT(!frames.empty() && frames.size() <= protocol::message_frames_max + 1);
    FRAJA_ASSERT(byte_count(frames) <= packed.size());
    check_decoding(frames);
}

/// Frames as they come: each a length of two bytes and so many bytes.
void decode_raw(Input& in) {
    if (in.once_in(2))
        return decode_packed(Blob::copy(std::as_bytes(in.take_all())));
    std::vector<Blob> frames;
    while (!in.empty() && frames.size() < 70) {
        const auto length = static_cast<std::size_t>(in.number(2));
        frames.push_back(Blob(in.bytes(length)));
    }
    check_decoding(frames);
}

/// A body of a known type: the header is right.
void decode_body(Input& in) {
    std::uint16_t type = 0;
    const std::uint8_t choice = in.byte();
    const bool at_version_before = choice >= 128;
    std::size_t at = choice % std::variant_size_v<protocol::MessageVariant>;
    for_each_message_type([&]<class M>(std::type_identity<M>) {
        if (at-- == 0)
            type = M::type;
    });
    Bytes header = protocol::encode(protocol::Beat{}).header;
    if (at_version_before)
        header[4] = std::byte(protocol::oldest_version_spoken & 0xff);
    header[6] = std::byte(type & 0xff);
    header[7] = std::byte(type >> 8);
    std::vector<Blob> frames = {Blob(header), Blob()};
    for (std::uint32_t blobs = in.below(3); blobs > 0; --blobs)
        frames.push_back(Blob(in.bytes(in.below(4))));
    const auto body = std::as_bytes(in.take_all());
    frames[1] = Blob::copy(body);
    check_decoding(frames);
    check_kept<protocol::SubmitJob>(body);
    check_kept<protocol::TileDone>(body);
}

/// A message that is one, with a byte of it changed.
void decode_nearly(Input& in) {
    const protocol::Packet packet = protocol::encode(any_message(in));
    std::vector<Blob> frames = frames_of(packet);
    const Blob packed = protocol::packed(packet);
    FRAJA_ASSERT(protocol::unpack(packed) == frames);
    Bytes nearly(packed.begin(), packed.end());
    nearly[in.number(2) % nearly.size()] = std::byte(in.byte());
    decode_packed(Blob(std::move(nearly)));
    check_decoding(frames);
    Bytes body = packet.body;
    for (std::uint32_t changes = in.below(4); changes > 0 && !body.empty(); --changes)
        body[in.number(2) % body.size()] = std::byte(in.byte());
    if (in.once_in(4))
        body.resize(in.number(2) % (body.size() + 1));
    check_kept<protocol::SubmitJob>(body);
    check_kept<protocol::TileDone>(body);
    frames[1] = Blob(body);
    check_decoding(frames);
}

void parse_numbers(const std::string& text) {
    if (const auto count = parse_count(text); count && !text.starts_with('0'))
        FRAJA_ASSERT(std::to_string(*count) == text);
    if (const auto size = parse_extent(text))
        FRAJA_ASSERT(
            parse_extent(std::to_string(size->width) + "x" + std::to_string(size->height)) == size);
    if (const auto rect = parse_rect(text))
        (void)rect->inside(Extent{100, 100});
    if (const auto duration = parse_duration(text)) {
        FRAJA_ASSERT(*duration >= Duration::zero());
        FRAJA_ASSERT(*duration <= std::chrono::hours(24 * 366 * 10));
        FRAJA_ASSERT(!format_duration(*duration).empty());
    }
    (void)parse_byte_size(text);
}

void parse_names(Input& in, const std::string& text) {
    constexpr std::string_view names[] = {"radius", "raja.shape.Sphere", "", "x", "--size"};
    (void)nearest_name(text, names);
    const std::size_t bytes_max = in.below(300);
    const std::string_view cut = clipped(text, bytes_max);
    FRAJA_ASSERT(cut.size() <= bytes_max && text.starts_with(cut));
    const std::string shown = printable(text);
    for (std::size_t i = 0; i < shown.size(); ++i) {
        const auto c = static_cast<unsigned char>(shown[i]);
        const unsigned next = i + 1 < shown.size() ? static_cast<unsigned char>(shown[i + 1]) : 0;
        FRAJA_ASSERT(c >= 0x20 && c != 0x7f && !(c == 0xc2 && next >= 0x80 && next < 0xa0));
    }
    if (const auto id = parse_id<JobId>(text))
        FRAJA_ASSERT(parse_id<JobId>(to_string(*id)) == id);
    if (const auto job = protocol::topic_id<JobId>('J', text))
        FRAJA_ASSERT(protocol::job_topic(*job) == text);
    if (const auto nonce = protocol::topic_id<Nonce>('N', text))
        FRAJA_ASSERT(protocol::barrier_topic(*nonce) == text);
}

void parse_endpoints(Input& in, const std::string& text) {
    const auto endpoint = net::parse_endpoint(text, static_cast<std::uint16_t>(in.number(2)));
    if (!endpoint) {
        FRAJA_ASSERT(!endpoint.error().message.empty());
        return;
    }
    const auto again = net::parse_endpoint(net::to_string(*endpoint), 1);
    FRAJA_ASSERT(again && *again == *endpoint);
    (void)net::is_loopback(*endpoint);
    const std::string told = "tcp://*:" + std::to_string(in.number(2));
    if (const auto stream = net::stream_endpoint(text, told))
        FRAJA_ASSERT(net::parse_endpoint(*stream, 1).has_value());
    if (const auto stream = net::stream_endpoint("tcp://farm:50057", text))
        FRAJA_ASSERT(net::parse_endpoint(*stream, 1).has_value());
}

void parse_options(const std::string& text) {
    if (const auto frames = client::parse_frames(text))
        FRAJA_ASSERT(frames->first >= 1 && frames->first <= frames->last && frames->step >= 1);
    if (const auto share = client::parse_until(text))
        FRAJA_ASSERT(*share >= 0 && *share <= 1);
    if (client::check_frame_pattern(text)) {
        const std::string last = client::frame_file(text, UINT32_MAX);
        FRAJA_ASSERT(last != client::frame_file(text, 1) &&
                     last.find("4294967295") != std::string::npos);
    }
    if (const auto workers = worker::parse_emulated_workers(text))
        FRAJA_ASSERT(workers->count >= 1 && workers->rays_per_s > 0);
    else
        FRAJA_ASSERT(!workers.error().message.empty());
}

void parse_text(Input& in) {
    Input numbers = in; // the same bytes again: text is read whole
    const auto all = in.take_all();
    const std::string text(all.begin(), all.end());
    parse_numbers(text);
    parse_names(numbers, text);
    parse_endpoints(numbers, text);
    parse_options(text);
}

void check_settings(Input& in) {
    auto s = small_picture(in);
    std::apply([&](const auto&... f) { ((in.once_in(3) ? fill(in, s.*f.member) : void()), ...); },
               protocol::PictureSettings::fields());
    if (const auto valid = protocol::validate(s); !valid) {
        FRAJA_ASSERT(!valid.error().message.empty());
        return;
    }
    FRAJA_ASSERT(s.crop.inside(s.size) && !s.crop.empty());
    FRAJA_ASSERT(s.size.pixel_count() <= protocol::picture_pixels_max);
    FRAJA_ASSERT(protocol::pass_count(s) >= 1 && s.pixel_bytes() > 0);
    const PixelRect cells = cells_of(s.crop, 1 + in.below(1024));
    FRAJA_ASSERT(cells.width >= 1 && cells.height >= 1);
}

void check_bitmap(Input& in) {
    const std::uint32_t count = in.below(256);
    protocol::Bitmap bitmap(count);
    std::vector<bool> wanted(count + 16);
    while (!in.empty() && count > 0) {
        const std::uint32_t at = in.below(count);
        bitmap.set(at);
        wanted[at] = true;
    }
    const protocol::Bitmap again{Bytes(bitmap.bytes())};
    for (std::size_t i = 0; i < wanted.size(); ++i)
        FRAJA_ASSERT(bitmap.test(i) == wanted[i] && again.test(i) == wanted[i]);
    FRAJA_ASSERT(!bitmap.test(std::uint64_t{1} << 40));
}

} // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    Input in(data, size);
    switch (in.below(8)) {
    case 0:
        decode_raw(in);
        break;
    case 1:
    case 2:
        decode_body(in);
        break;
    case 3:
        decode_nearly(in);
        break;
    case 4:
    case 5:
        parse_text(in);
        break;
    case 6:
        check_settings(in);
        break;
    case 7:
        check_bitmap(in);
        break;
    }
    return 0;
}
