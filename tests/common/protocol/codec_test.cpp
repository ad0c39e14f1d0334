#include "common/protocol/codec.hpp"

#include "common/protocol/limits.hpp"
#include "tests/support/messages.hpp"
#include "tests/support/seeds.hpp"

#include <algorithm>
#include <doctest/doctest.h>
#include <sys/resource.h>

using namespace fraja;
using namespace fraja::protocol;

namespace {

std::vector<Blob> frames_of(const Packet& packet) {
    std::vector<Blob> frames{Blob(packet.header), Blob(packet.body)};
    frames.insert(frames.end(), packet.blobs.begin(), packet.blobs.end());
    return frames;
}

std::vector<Blob> frames_of(Bytes header, Bytes body) {
    return {Blob(std::move(header)), Blob(std::move(body))};
}

Bytes raw(std::initializer_list<unsigned> bytes) {
    Bytes result;
    for (const unsigned b : bytes)
        result.push_back(std::byte(b));
    return result;
}

Bytes header_of(unsigned type, unsigned at_version = version) {
    return raw({'F', 'R', 'J', 'A', at_version & 0xff, at_version >> 8, type & 0xff, type >> 8});
}

ErrorCode refusal(const std::vector<Blob>& frames) {
    const auto message = decode(frames);
    REQUIRE_FALSE(message.has_value());
    CHECK_FALSE(message.error().message.empty());
    return message.error().code;
}

/// The same message gives the same bytes, so comparing packets compares messages, blobs included.
bool same(const Packet& a, const Packet& b) {
    return a.header == b.header && a.body == b.body && a.blobs == b.blobs;
}

} // namespace

TEST_CASE("every message survives the wire") {
    for_each_seed(500, [](Rng& rng) {
        for_each_message_type([&]<class M>(std::type_identity<M>) {
            CAPTURE(M::name);
            const Message message = random_message_of<M>(rng);
            const Packet packet = encode(message);
            const auto read = decode(frames_of(packet));
            REQUIRE_MESSAGE(read.has_value(), (read ? "" : read.error().message));
            CHECK(std::holds_alternative<M>(*read));
            CHECK(same(encode(*read), packet));
        });
    });
}

TEST_CASE("the bytes of a message do not drift") {
    // Written out by hand from PROTOCOL.md: a change of these bytes is a new version of the
    // protocol.
    const Packet packet = encode(NeedChunk{ContentHash{}, 0x80000});
    CHECK(packet.header == raw({'F', 'R', 'J', 'A', 12, 0, 10, 0}));
    Bytes body = raw({0x92, 0xc4, 32});
    body.insert(body.end(), 32, std::byte{0});
    for (const unsigned b : {0xceu, 0x00u, 0x08u, 0x00u, 0x00u})
        body.push_back(std::byte(b));
    CHECK(packet.body == body);
    CHECK(packet.blobs.empty());
}

TEST_CASE("a message of another version is told from rubbish") {
    for (const unsigned other : {oldest_version_spoken - 1u, version + 1u, 0u, 0xffffu})
        for (const auto& frames : {frames_of(header_of(Beat::type, other), raw({0x90})),
                                   {Blob(header_of(Beat::type, other))}})
            CHECK(refusal(frames) == ErrorCode::version_mismatch);
    const auto said = [](unsigned other) {
        return decode(frames_of(header_of(Beat::type, other), raw({0x90}))).error().message;
    };
    CHECK(said(9) == "the peer speaks protocol version 9, this program versions 11 and 12: the "
                     "peer is too old, and must be updated");
    CHECK(said(14) == "the peer speaks protocol version 14, this program versions 11 and 12: this "
                      "program is too old, and must be updated");
    Bytes longer = header_of(Beat::type, version + 1u); // a later version may have a longer header
    longer.push_back(std::byte{1});
    CHECK(refusal(frames_of(longer, raw({0x90}))) == ErrorCode::version_mismatch);
}

TEST_CASE("the version before is spoken as well") {
    const Packet packet = encode(NeedChunk{ContentHash{}, 0x80000}, 11);
    CHECK(packet.header == raw({'F', 'R', 'J', 'A', 11, 0, 10, 0}));
    CHECK(decode(frames_of(packet)).has_value());
    CHECK(version_of(frames_of(packet)) == 11);
    CHECK(version_of(frames_of(header_of(Beat::type, 700), {})) == 700);
    CHECK_FALSE(version_of(frames_of(raw({'F', 'R', 'J'}), {})).has_value());
    CHECK_FALSE(version_of({}).has_value());
    // What it does not know is said in its words.
    const auto code_of = [](const Packet& said) {
        return std::get<Refused>(*decode(frames_of(said))).code;
    };
    const Refused refused{RefusalCode::not_allowed, {}, "no"};
    CHECK(code_of(encode(refused, 12)) == RefusalCode::not_allowed);
    CHECK(code_of(encode(refused, 11)) == RefusalCode::unexpected);
    CHECK(code_of(encode(Refused{RefusalCode::conflict, {}, "no"}, 11)) == RefusalCode::conflict);
    CHECK(is_known_to(12, Brokers{}));
    CHECK_FALSE(is_known_to(11, Brokers{}));
    CHECK(is_known_to(11, Beat{}));
}

TEST_CASE("what is not exactly a message is refused") {
    struct Row {
        const char* what;
        std::vector<Blob> frames;
    };
    const Blob blob = Blob(raw({1, 2, 3}));
    std::vector<Blob> with_blob = frames_of(header_of(Beat::type), raw({0x90}));
    with_blob.push_back(blob);
    std::vector<Blob> many(message_frames_max + 1, blob);
    many[0] = Blob(header_of(TileDone::type));
    std::vector<Blob> huge = frames_of(header_of(Beat::type), Bytes(frame_bytes_max + 1));
    for (const Row& row : {
             Row{"no frame", {}},
             Row{"one frame", {Blob(header_of(Beat::type))}},
             Row{"empty header", frames_of({}, raw({0x90}))},
             Row{"another magic", frames_of(raw({'F', 'R', 'A', 'J', 12, 0, 5, 0}), raw({0x90}))},
             Row{"short header", frames_of(raw({'F', 'R', 'J', 'A', 12, 0, 5}), raw({0x90}))},
             Row{"long header", frames_of(raw({'F', 'R', 'J', 'A', 12, 0, 5, 0, 0}), raw({0x90}))},
             Row{"unknown type", frames_of(header_of(999), raw({0x90}))},
             Row{"empty body", frames_of(header_of(Beat::type), {})},
             Row{"body is no array", frames_of(header_of(Beat::type), raw({0x01}))},
             Row{"body is a map", frames_of(header_of(Beat::type), raw({0x80}))},
             Row{"bytes after the body", frames_of(header_of(Beat::type), raw({0x90, 0x90}))},
             Row{"a field is missing", frames_of(header_of(NeedChunk::type), raw({0x90}))},
             Row{"a field of the wrong type",
                 frames_of(header_of(FindJob::type), raw({0x91, 0x05}))},
             Row{"a truncated string",
                 frames_of(header_of(FindJob::type), raw({0x91, 0xa5, 'a', 'b'}))},
             Row{"an id of 3 bytes",
                 frames_of(header_of(ControlJob::type), raw({0x93, 0xc4, 3, 1, 2, 3, 0, 0}))},
             Row{"an unknown enum value",
                 frames_of(header_of(Refused::type),
                           [] {
                               Bytes body = encode(Refused{RefusalCode::invalid, {}, "x"}).body;
                               body[1] = std::byte{100};
                               return body;
                           }())},
             Row{"a number beyond its type",
                 frames_of(header_of(RepairDone::type),
                           raw({0x92, 0xcf, 255, 255, 255, 255, 255, 255, 255, 255}))},
             Row{"blobs where none belong", with_blob},
             Row{"no blob where one belongs",
                 frames_of(header_of(Chunk::type),
                           encode(Chunk{ContentHash{}, 0, 3, {blob}}).body)},
             Row{"too many frames", many},
             Row{"a frame that is too large", huge},
         }) {
        CAPTURE(row.what);
        CHECK(refusal(row.frames) == ErrorCode::malformed_frame);
    }
}

TEST_CASE("unknown trailing fields are ignored so that versions can live together") {
    const auto message =
        decode(frames_of(header_of(FindJob::type), raw({0x93, 0xa1, '7', 0xc0, 0x05})));
    REQUIRE(message.has_value());
    CHECK(std::get<FindJob>(*message).what == "7");
}

TEST_CASE("what was kept is read by every version of the protocol") {
    SubmitJob job;
    job.job_name = "cup";
    job.scene_bytes = 5;
    job.tile_side = 32;
    job.priority = -2;
    job.job.bytes.fill(1);
    job.scene.bytes.fill(2);
    job.settings.size = {8, 6};
    job.settings.crop = {0, 0, 8, 6};
    job.settings.spp = 16;
    const auto body_of = [](unsigned fields, std::initializer_list<unsigned> settings,
                            std::initializer_list<unsigned> rest) {
        Bytes body = raw({0x90 + fields, 0xc4, 16});
        body.insert(body.end(), 16, std::byte{1});
        const auto append = [&](const Bytes& bytes) {
            body.insert(body.end(), bytes.begin(), bytes.end());
        };
        append(raw({0xa3, 'c', 'u', 'p', 0xc4, 32}));
        body.insert(body.end(), 32, std::byte{2});
        append(raw({5}));
        append(raw(settings));
        append(raw(rest));
        return body;
    };
    // A submission as version 4 wrote it: this test stays as it is when there are more fields.
    const Bytes kept =
        body_of(8, {0x9b, 0x92, 8, 6, 0x94, 0, 0, 8, 6, 5, 0, 0xc2, 1, 16, 0, 0xcd, 4, 0, 0, 0},
                {32, 0, 0xfe});
    CHECK(decode_kept<SubmitJob>(kept).value() == job);
    // As a version would have written it that knew neither samples nor orders and priorities.
    const Bytes older = body_of(6, {0x97, 0x92, 8, 6, 0x94, 0, 0, 8, 6, 5, 0, 0xc2, 1, 16}, {32});
    job.priority = 0;
    CHECK(decode_kept<SubmitJob>(older).value() == job);
    CHECK(refusal(frames_of(header_of(SubmitJob::type), older)) == ErrorCode::malformed_frame);
    // As version 5 wrote it, whose wishes knew no films.
    const Bytes no_films =
        body_of(10, {0x9b, 0x92, 8, 6, 0x94, 0, 0, 8, 6, 5, 0, 0xc2, 1, 16, 0, 0xcd, 4, 0, 0, 0},
                {32, 0, 0xfe, 0x93, 0, 3, 0x90, 0xc2});
    SubmitJob single = job;
    single.priority = -2;
    single.wishes.workers_max = 3;
    CHECK(decode_kept<SubmitJob>(no_films).value() == single);
    CHECK(refusal(frames_of(header_of(SubmitJob::type), no_films)) == ErrorCode::malformed_frame);
    // And one to come, with fields that nobody knows yet.
    const Bytes newer = body_of(
        11, {0x9d, 0x92, 8, 6, 0x94, 0, 0, 8, 6, 5, 0, 0xc2, 1, 16, 0, 0xcd, 4, 0, 0, 0, 0xc2, 1},
        {32, 0, 0, 0x93, 0, 0, 0x90, 0xc2, 0xa1, 'x'});
    CHECK(decode_kept<SubmitJob>(newer).value() == job);
    CHECK(decode_kept<SubmitJob>(raw({0xc0})).error().code == ErrorCode::malformed_frame);
    CHECK(decode_kept<SubmitJob>(Bytes()).error().code == ErrorCode::malformed_frame);
}

TEST_CASE("what was kept of a tile is read without its pixels") {
    for_each_seed(50, [](Rng& rng) {
        const auto tile = random_message_of<TileDone>(rng);
        const auto read = decode_kept<TileDone>(encode(tile).body);
        REQUIRE(read.has_value());
        CHECK(read->blobs.empty());
        CHECK(read->rays == tile.rays);
        CHECK(read->worker_name == tile.worker_name);
        CHECK(read->tile == tile.tile);
        CHECK(read->worker == tile.worker);
        // As a version wrote it that knew nothing of who drew it but a name.
        TileDone undated = tile;
        undated.epoch = 0;
        Bytes older = encode(undated).body;
        older[0] = std::byte{0x98};
        older.resize(older.size() - 19);
        const auto nameless = decode_kept<TileDone>(older);
        REQUIRE(nameless.has_value());
        CHECK(nameless->worker == WorkerId{});
        CHECK(nameless->elapsed == tile.elapsed);
    });
}

TEST_CASE("a number that happens to be whole survives the wire") {
    for (const double speed : {0.0, 1.0, -3.0, 1e18, 0.5}) {
        WorkerHello hello;
        hello.speed_rays_per_s = speed;
        const auto read = decode(frames_of(encode(hello)));
        REQUIRE(read.has_value());
        CHECK(std::get<WorkerHello>(*read).speed_rays_per_s == speed);
    }
}

TEST_CASE("a number that is not finite is refused") {
    Bytes body = encode(random_message_of<WorkerHello>(*std::make_unique<Rng>(1))).body;
    const Bytes nan = raw({0xcb, 0x7f, 0xf8, 0, 0, 0, 0, 0, 0});
    const auto at = std::ranges::find(body, std::byte{0xcb});
    REQUIRE(at != body.end());
    std::ranges::copy(nan, at);
    CHECK(refusal(frames_of(header_of(WorkerHello::type), body)) == ErrorCode::malformed_frame);
}

TEST_CASE("msgpack bombs cost no more than their own size") {
    rusage before{}, after{};
    getrusage(RUSAGE_SELF, &before);
    const std::vector<Bytes> bombs = {
        raw({0xdd, 0xff, 0xff, 0xff, 0xff}),          // an array of 4 billion
        raw({0x91, 0xdd, 0xff, 0xff, 0xff, 0xff}),    // one within an array
        raw({0xdf, 0xff, 0xff, 0xff, 0xff}),          // a map
        raw({0x91, 0xdb, 0xff, 0xff, 0xff, 0xff}),    // a string of 4 GiB
        raw({0x91, 0xc6, 0xff, 0xff, 0xff, 0xff}),    // bytes
        raw({0x91, 0xc9, 0xff, 0xff, 0xff, 0xff, 1}), // an extension
        Bytes(frame_bytes_max, std::byte{0x91}),      // arrays within arrays, a million deep
        Bytes(frame_bytes_max, std::byte{0x81}),
    };
    for_each_message_type([&]<class M>(std::type_identity<M>) {
        for (const Bytes& bomb : bombs) {
            std::vector<Blob> frames = frames_of(header_of(M::type), bomb);
            if (CarriesBlobs<M>)
                frames.push_back(Blob(raw({0})));
            CHECK_FALSE(decode(frames).has_value());
        }
    });
    getrusage(RUSAGE_SELF, &after);
    CHECK(after.ru_maxrss - before.ru_maxrss < 256 * 1024); // KiB
}

TEST_CASE("arrays nest as deep as nesting_max and no deeper") {
    const auto nested = [](std::size_t depth) { // a Goodbye, whose further fields are ignored
        Bytes body(depth - 1, std::byte{0x91});
        body.push_back(std::byte{0x90});
        return decode(frames_of(header_of(Goodbye::type), body)).has_value();
    };
    CHECK(nested(nesting_max));
    CHECK_FALSE(nested(nesting_max + 1));
}

TEST_CASE("a string has string_bytes_max bytes and no more") {
    const auto of_length = [](std::size_t length) {
        Bytes body = raw(
            {0x91, 0xda, static_cast<unsigned>(length >> 8), static_cast<unsigned>(length & 255)});
        body.insert(body.end(), length, std::byte{'x'});
        return decode(frames_of(header_of(FindJob::type), body)).has_value();
    };
    CHECK(of_length(string_bytes_max));
    CHECK_FALSE(of_length(string_bytes_max + 1));
}

TEST_CASE("random and mutated bytes never do harm") {
    for_each_seed(3'000, [](Rng& rng) {
        const Packet packet = encode(random_message(rng));
        std::vector<Blob> frames = frames_of(packet);
        const std::size_t changed = rng.below(2);
        Bytes frame(frames[changed].begin(), frames[changed].end());
        switch (rng.below(3)) {
        case 0: // some bytes change
            for (int i = 0; i < 3 && !frame.empty(); ++i)
                frame[rng.below(frame.size())] = static_cast<std::byte>(rng.next());
            break;
        case 1: // the frame ends early
            frame.resize(rng.below(frame.size() + 1));
            break;
        default: // it is all noise
            for (std::byte& b : frame)
                b = static_cast<std::byte>(rng.next());
        }
        frames[changed] = Blob(std::move(frame));
        const auto message = decode(frames);
        if (message) // what is taken can be written again
            CHECK(decode(frames_of(encode(*message))).has_value());
    });
}
