// What the version before said is understood, and what is said to it it understands.
#include "common/protocol/codec.hpp"
#include "tests/captures/capture.hpp"
#include "tests/captures/kept_page.hpp"
#include "tests/support/messages.hpp"
#include "tests/support/seeds.hpp"

#include <set>

using namespace fraja;
using namespace fraja::protocol;

TEST_CASE("whoever speaks this version speaks the one before it, whose bytes are kept") {
    CHECK(oldest_version_spoken == version - 1);
    CHECK(is_spoken(version));
    CHECK(is_spoken(version - 1));
    CHECK_FALSE(is_spoken(version - 2));
    CHECK_FALSE(is_spoken(version + 1));
    CHECK(std::filesystem::exists(captures / last_version / "PROTOCOL.md"));
}

TEST_CASE("what programs of the version before have said is understood") {
    std::set<std::string_view> names;
    const KeptPage page(oldest_version_spoken);
    for (const auto& file : capture_files(last_version + "/all_old")) {
        CAPTURE(file.string());
        for (const Captured& said : read_capture(file)) {
            if (is_of_stream(file) && said.from_caller)
                continue; // a subscription
            const auto frames = is_of_stream(file) ? said.published() : said.unpacked();
            CHECK(version_of(frames) == oldest_version_spoken);
            CHECK(page.complaint(frames) == ""); // the page is what they went by
            const auto message = decode(frames);
            REQUIRE_MESSAGE(message.has_value(), (message ? "" : message.error().message));
            names.insert(name_of(*message));
        }
    }
    for (const std::string name :
         {"WorkerHello", "ClientHello", "Welcome",    "Refused",       "Beat",       "WorkerBeat",
          "Goodbye",     "NeedChunk",   "Chunk",      "SubmitJob",     "JobState",   "FindJob",
          "ControlJob",  "Repair",      "RepairDone", "ControlWorker", "RenderTile", "TileRendered",
          "TileDone",    "Barrier",     "FarmState",  "TileFailed",    "CancelTile", "Dismissed"}) {
        CAPTURE(name);
        CHECK(names.contains(name));
    }
}

TEST_CASE("what is said in the version before is as that version's page has it") {
    const KeptPage page(oldest_version_spoken);
    for_each_seed(200, [&](Rng& rng) {
        for_each_message_type([&]<class M>(std::type_identity<M>) {
            CAPTURE(M::name);
            const Message message = random_message_of<M>(rng);
            CHECK(page.knows(M::type) == is_known_to(oldest_version_spoken, message));
            if (page.knows(M::type))
                CHECK(page.complaint(frames_of(encode(message, oldest_version_spoken))) == "");
        });
    });
}

TEST_CASE("what came with this version may be missing in the one before, and nothing else may") {
    const KeptPage page(oldest_version_spoken);
    for_each_seed(50, [&](Rng& rng) {
        for_each_message_type([&]<class M>(std::type_identity<M>) {
            if (!page.knows(M::type))
                return;
            CAPTURE(M::name);
            const auto frames = frames_of(encode(random_message_of<M>(rng), oldest_version_spoken));
            const auto then = page.trimmed(frames);
            REQUIRE(then.has_value());
            const auto read = decode(*then);
            REQUIRE_MESSAGE(read.has_value(), (read ? "" : read.error().message));
            // Nothing is lost of what was there.
            CHECK(page.trimmed(frames_of(encode(*read, oldest_version_spoken))) == then);
            if (const auto less = page.trimmed(frames, KeptPage::Trim::one_field_less))
                CHECK(decode(*less).error().code == ErrorCode::malformed_frame);
            // Who says to be of this version has all of it.
            auto now = *then;
            Bytes header(now[0].begin(), now[0].end());
            header[4] = static_cast<std::byte>(version);
            now[0] = Blob(std::move(header));
            CHECK(decode(now).has_value() == (now[1] == frames[1]));
        });
    });
}

TEST_CASE("a message that came with this version is none of the one before") {
    for_each_message_type([&]<class M>(std::type_identity<M>) {
        if (is_known_to(oldest_version_spoken, Message(M{})))
            return;
        CAPTURE(M::name);
        auto frames = frames_of(encode(Message(M{})));
        Bytes header(frames[0].begin(), frames[0].end());
        header[4] = static_cast<std::byte>(oldest_version_spoken);
        frames[0] = Blob(std::move(header));
        CHECK(decode(frames).error().code == ErrorCode::malformed_frame);
    });
}
