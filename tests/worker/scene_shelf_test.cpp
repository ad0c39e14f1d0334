#include "worker/scene_shelf.hpp"

#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::worker;

namespace {

ContentHash hash(std::uint8_t number) {
    ContentHash h;
    h.bytes[0] = number;
    return h;
}

void put(SceneShelf& shelf, std::uint8_t number, std::uint64_t bytes, SceneOnShelf::Stage stage) {
    shelf.use(hash(number), bytes).stage = stage;
    shelf.release(hash(number));
}

} // namespace

using Stage = SceneOnShelf::Stage;

TEST_CASE("a shelf keeps idle scenes within both limits, and those in use always") {
    SceneShelf shelf({.idle_bytes_max = 100, .idle_count_max = 3});
    put(shelf, 1, 40, Stage::ready);
    put(shelf, 2, 40, Stage::ready);
    CHECK(shelf.take_surplus().empty());
    put(shelf, 3, 40, Stage::ready);
    CHECK(shelf.take_surplus() == std::vector{hash(1)});
    (void)shelf.use(hash(2), 40); // in use: not idle
    put(shelf, 4, 60, Stage::ready);
    CHECK(shelf.take_surplus().empty());
    put(shelf, 5, 1000, Stage::compiling); // nor is this
    CHECK(shelf.take_surplus().empty());
    shelf.release(hash(2)); // used after 3
    CHECK(shelf.take_surplus() == std::vector{hash(3)});
    CHECK(shelf.find(hash(2)) != nullptr);
}

TEST_CASE("refused scenes take room but need not be forgotten by anybody else") {
    SceneShelf shelf({.idle_bytes_max = 100, .idle_count_max = 1});
    put(shelf, 1, 10, Stage::refused);
    put(shelf, 2, 10, Stage::ready);
    CHECK(shelf.take_surplus().empty());
    CHECK(shelf.find(hash(1)) == nullptr);
}

TEST_CASE("a scene that is fetched for nobody any more is not fetched") {
    SceneShelf shelf({});
    (void)shelf.use(hash(1), 10);
    (void)shelf.use(hash(1), 10);
    shelf.release(hash(1));
    CHECK(shelf.find(hash(1)) != nullptr);
    shelf.release(hash(1));
    CHECK(shelf.find(hash(1)) == nullptr);
}

TEST_CASE("the oldest ask is the one that is answered next") {
    SceneShelf shelf({});
    for (std::uint8_t number = 1; number <= 3; ++number)
        shelf.note_ask(shelf.use(hash(number), 10), Instant{});
    CHECK(shelf.oldest_ask()->first == hash(1));
    shelf.note_ask(*shelf.find(hash(1)), Instant{});
    CHECK(shelf.oldest_ask()->first == hash(2));
    shelf.find(hash(2))->stage = Stage::ready;
    CHECK(shelf.oldest_ask()->first == hash(3));
}
