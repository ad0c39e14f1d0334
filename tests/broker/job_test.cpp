#include "broker/job.hpp"

#include "tests/broker/farm.hpp"
#include "tests/support/seeds.hpp"

#include <ctime>
#include <doctest/doctest.h>
#include <map>
#include <vector>

namespace fraja::broker {
namespace {

using namespace protocol;

/// As a probe tells of four blocks side by side.
std::vector<double> spots_of(const Job& job, const std::vector<double>& blocks) {
    std::vector<double> spots;
    for (std::size_t i = 0; i < job.costs().spot_count(); ++i)
        spots.push_back(blocks.at(job.costs().block_of(job.costs().spot(i))));
    return spots;
}

std::shared_ptr<const TileDone> done_with(const Job& job, const Tile& tile) {
    TileDone done;
    done.job = job.id();
    done.tile = job.index(tile);
    done.rect = job.rect(tile);
    done.rays.camera = done.rect.pixel_count();
    return std::make_shared<const TileDone>(done);
}

/// Hands tiles out to workers 1, 2, ... and takes them back.
struct Desk {
    Job job;
    double joined_work_max = 0;
    std::optional<double> scout_work{};
    std::uint32_t attempts = 0;
    struct AtWork {
        Job::Handed handed;
        AttemptNumber attempt{};
    };
    std::map<OpenTileId, AtWork> at_work{};

    std::optional<Job::Handed> hand_out(std::uint8_t worker, double work_wanted,
                                        std::size_t workers = 9) {
        auto handed = job.assign_next(
            {.worker = id_of<WorkerId>(worker),
             .peer = std::to_string(worker),
             .work_wanted = work_wanted,
             .joined_work_max = joined_work_max,
             .scout_work = scout_work,
             .has_others =
                 [&](std::span<const WorkerId> failed_on) {
                     return std::set(failed_on.begin(), failed_on.end()).size() < workers;
                 },
             .attempt = AttemptNumber{++attempts}});
        if (handed)
            at_work[handed->id] = {*handed, AttemptNumber{attempts}};
        return handed;
    }
    std::vector<Job::Unwanted> finish(const Job::Handed& handed) {
        at_work.erase(handed.id);
        return job.finish(handed.id, handed.tile, handed.work, done_with(job, handed.tile));
    }
};

TEST_CASE("of a tile that is too much a part is handed out, and the rest later") {
    Desk desk{Job(automatic(1, 64, 64), 1, "c")}; // one block of 32 x 32 cells
    const auto first = desk.hand_out(1, 100);
    REQUIRE(first);
    CHECK(first->work <= 100);
    CHECK(first->work > 49);
    CHECK(desk.job.rect(first->tile).x == 0);
    std::uint64_t pixels = desk.job.rect(first->tile).pixel_count();
    while (const auto next = desk.hand_out(1, 1e9))
        pixels += desk.job.rect(next->tile).pixel_count();
    CHECK(pixels == 64 * 64);
    CHECK_FALSE(desk.job.has_pending());
}

TEST_CASE("fresh blocks are joined up to what is wanted, and never beyond a tile's side") {
    Desk desk{Job(automatic(1, 2048, 2048), 1, "c"), 1e9};
    std::uint64_t pixels = 0;
    const auto next = [&](double wanted) {
        const auto handed = desk.hand_out(1, wanted);
        REQUIRE(handed);
        const PixelRect rect = desk.job.rect(handed->tile);
        pixels += rect.pixel_count();
        return Extent{rect.width, rect.height};
    };
    CHECK(next(1e9) == Extent{1024, 1024});
    CHECK(next(1024 * 1024 - 1) == Extent{512, 512});
    CHECK(next(4 * 64 * 64) == Extent{128, 128}); // beside that
    CHECK(next(64 * 64) == Extent{64, 64});       // beside these
    CHECK(next(1e9) == Extent{64, 64});           // beside that: not all around it is fresh
    desk.joined_work_max = 64 * 64;
    CHECK(next(1e9) == Extent{64, 64});
    desk.joined_work_max = 1e9;
    while (desk.job.has_pending())
        (void)next(1e9);
    CHECK(pixels == std::uint64_t{2048} * 2048);
}

TEST_CASE("at the borders as much is joined as is there") {
    Desk desk{Job(automatic(1, 200, 70), 1, "c"), 1e9};
    const auto handed = desk.hand_out(1, 1e9);
    REQUIRE(handed);
    CHECK(desk.job.rect(handed->tile) == PixelRect{0, 0, 200, 70});
    CHECK_FALSE(desk.job.has_pending());
}

TEST_CASE("what comes back is not joined, nor where an order was asked for") {
    Desk desk{Job(automatic(1, 256, 256), 1, "c"), 1e9};
    const auto block = desk.hand_out(1, 64 * 64);
    REQUIRE(block);
    desk.job.requeue(block->id);
    const auto again = desk.hand_out(2, 1e9);
    REQUIRE(again);
    CHECK(again->tile == block->tile);

    (void)desk.job.drop_unfinished(); // and what was dropped is no more
    desk.at_work.clear();
    (void)desk.job.revive();
    const auto whole = desk.hand_out(2, 1e9);
    REQUIRE(whole);
    CHECK(desk.job.rect(whole->tile) == PixelRect{0, 0, 256, 256});

    SubmitJob s = automatic(1, 256, 256);
    s.order = TileOrder::scan;
    Desk scan{Job(s, 1, "c"), 1e9};
    const auto first = scan.hand_out(1, 1e9);
    REQUIRE(first);
    CHECK(scan.job.rect(first->tile) == PixelRect{0, 0, 64, 64});
}

TEST_CASE("no tile is smaller than a cell, however little is wanted") {
    Desk desk{Job(automatic(1, 20, 10), 1, "c")};
    const auto handed = desk.hand_out(1, 0);
    REQUIRE(handed);
    CHECK(desk.job.rect(handed->tile) == PixelRect{0, 0, 2, 2});
}

TEST_CASE("what a probe finds to be the most work goes first") {
    Desk desk{Job(automatic(1, 256, 64), 1, "c")};
    desk.job.take_probe(spots_of(desk.job, {1, 5, 3, 4}));
    std::vector<std::uint32_t> columns;
    while (const auto handed = desk.hand_out(1, 1e9))
        columns.push_back(desk.job.rect(handed->tile).x / 64);
    CHECK(columns == std::vector<std::uint32_t>{1, 3, 2, 0});
}

TEST_CASE("scouts go first: small, far from one another, and what is around them is left") {
    Desk desk{Job(automatic(1, 640, 480), 1, "c"), 1e9, 0.0};
    std::vector<double> blocks(desk.job.costs().block_columns() * desk.job.costs().block_rows(), 1);
    blocks[33] = 9;
    desk.job.take_probe(spots_of(desk.job, blocks));
    std::set<std::size_t> scouted;
    std::uint64_t pixels = 0;
    const std::size_t wanted = desk.job.costs().scattered_spots().size();
    CHECK(wanted == 60); // a twentieth
    for (std::size_t i = 0; i < wanted; ++i) {
        const auto scout = desk.hand_out(1, 1e9);
        REQUIRE(scout);
        CHECK(desk.job.rect(scout->tile).pixel_count() == 16 * 16);
        CHECK(scouted.insert(desk.job.costs().block_of(scout->tile.cells)).second);
        pixels += 16 * 16;
    }
    const auto dearest = desk.hand_out(1, 1e9);
    REQUIRE(dearest);
    CHECK(desk.job.costs().block_of(dearest->tile.cells) == 33);
    pixels += desk.job.rect(dearest->tile).pixel_count();
    while (const auto next = desk.hand_out(1, 1e9))
        pixels += desk.job.rect(next->tile).pixel_count();
    CHECK(pixels == 640 * 480);
}

TEST_CASE("scouts are as much work as they should be, or a twentieth of the picture together") {
    struct Row {
        std::uint32_t side;
        double work;
        std::uint64_t pixels; ///< of each
    };
    for (const Row& row : {Row{4096, 0, 256}, Row{4096, 257, 512}, Row{4096, 2'000, 2'048},
                           Row{4096, 4'000, 4'096}, Row{1600, 2'000, 512}}) {
        CAPTURE(row.side);
        CAPTURE(row.work);
        Desk desk{Job(automatic(1, row.side, row.side), 1, "c"), 1e9, row.work};
        desk.job.take_probe(std::vector<double>(desk.job.costs().spot_count(), 1));
        for (std::size_t i = 0; i < desk.job.costs().scattered_spots().size(); ++i)
            CHECK(desk.job.rect(desk.hand_out(1, 1e9)->tile).pixel_count() == row.pixels);
    }
}

TEST_CASE("nobody scouts where it was not asked for, where an order was, or for too little work") {
    SubmitJob s = automatic(1, 640, 480);
    Desk plain{Job(s, 1, "c"), 1e9};
    CHECK(plain.job.rect(plain.hand_out(1, 64 * 64)->tile).pixel_count() == 64 * 64);
    Desk quick{Job(s, 1, "c"), 1e9, 16 * (16 * 16 + 1)};
    CHECK(quick.job.rect(quick.hand_out(1, 64 * 64)->tile).pixel_count() == 64 * 64);
    s.order = TileOrder::scan;
    Desk ordered{Job(s, 1, "c"), 1e9, 0.0};
    CHECK(ordered.job.rect(ordered.hand_out(1, 64 * 64)->tile).pixel_count() == 64 * 64);
}

TEST_CASE("an order that was asked for is kept, also with automatic tiles") {
    SubmitJob s = automatic(1, 256, 64);
    s.order = TileOrder::scan;
    Desk desk{Job(s, 1, "c")};
    desk.job.take_probe(spots_of(desk.job, {1, 5, 3, 4}));
    std::uint32_t last = 0;
    while (const auto handed = desk.hand_out(1, 2'000)) {
        CHECK(desk.job.rect(handed->tile).x / 64 >= last);
        last = desk.job.rect(handed->tile).x / 64;
    }
}

TEST_CASE("of what was overbooked the first answer counts, whole or parts") {
    for (const bool whole_first : {true, false}) {
        CAPTURE(whole_first);
        Desk desk{Job(automatic(1, 64, 64), 1, "c")};
        const auto whole = desk.hand_out(1, 1e9);
        REQUIRE(desk.job.can_overbook(whole->id));
        desk.job.overbook(whole->id, 4);
        CHECK_FALSE(desk.job.can_overbook(whole->id));
        std::vector<Job::Handed> parts;
        while (const auto part = desk.hand_out(2, 1e9))
            parts.push_back(*part);
        REQUIRE(parts.size() == 4);
        CHECK(desk.job.in_flight_count() == 5);
        if (whole_first) {
            CHECK(desk.finish(*whole).size() == 5); // itself, too: whoever asks knows
        } else {
            for (int i = 0; i < 3; ++i)
                CHECK(desk.finish(parts[static_cast<std::size_t>(i)]).size() == 1);
            const auto unwanted = desk.finish(parts[3]);
            REQUIRE(unwanted.size() == 2);
            CHECK(unwanted[0].assignment.peer == "1");
        }
        CHECK(desk.job.all_done());
        CHECK(desk.job.in_flight_count() == 0);
        CHECK(desk.job.workers().empty());
    }
}

TEST_CASE("an answer does not look at all that others have in hand") {
    constexpr std::size_t in_hand = 100'000;
    Desk desk{Job(automatic(1, 2'048, 2'048), 1, "c")};
    std::vector<Job::Handed> handed{*desk.hand_out(1, 1)};
    desk.job.overbook(handed.front().id, 1); // from now on tiles may share cells
    while (handed.size() < in_hand)
        handed.push_back(*desk.hand_out(2, 1));
    const std::clock_t begin = std::clock();
    std::size_t over = 0;
    for (std::size_t i = 1; i < handed.size(); ++i)
        over += desk.finish(handed[i]).size();
    CHECK(over == in_hand); // the first one, too, with its only part
    // Looking at all of them took minutes; sanitizers take ten times as long as this.
    CHECK(std::clock() - begin < 20 * CLOCKS_PER_SEC);
}

TEST_CASE("a whole that comes after one of its parts brings the others") {
    Desk desk{Job(automatic(1, 64, 64), 1, "c")};
    const auto whole = desk.hand_out(1, 1e9);
    desk.job.overbook(whole->id, 2);
    const auto part = desk.hand_out(2, 1e9);
    const auto other = desk.hand_out(3, 1e9);
    (void)desk.finish(*part);
    CHECK_FALSE(desk.job.all_done());
    const auto unwanted = desk.finish(*whole);
    CHECK(desk.job.all_done());
    CHECK(std::ranges::any_of(unwanted, [&](const auto& u) { return u.id == other->id; }));
    CHECK(desk.job.results().size() == 2);
    // A watcher that has the first half lacks the whole, one that has all lacks nothing.
    Bitmap have(static_cast<std::size_t>(desk.job.grid().count()));
    CHECK(desk.job.missing(have, [](const auto&) { return false; }) == 2);
    (void)desk.job.grid().all_of(part->tile.cells, [&](std::uint64_t cell) {
        have.set(static_cast<std::size_t>(cell));
        return true;
    });
    CHECK(desk.job.missing(have, [](const auto&) { return false; }) == 1);
}

TEST_CASE("nothing is lost when the whole is lost, nor when a part is, nor both") {
    for (const bool part_first : {true, false}) {
        CAPTURE(part_first);
        Desk desk{Job(automatic(1, 64, 64), 1, "c")};
        const auto whole = desk.hand_out(1, 1e9);
        desk.job.overbook(whole->id, 2);
        const auto part = desk.hand_out(2, 1e9);
        const auto other = desk.hand_out(3, 1e9);
        if (part_first) {
            desk.job.requeue(part->id); // the whole is still at it
            CHECK_FALSE(desk.job.has_pending());
            desk.job.requeue(whole->id); // now nobody has the part's cells
            CHECK(desk.job.has_pending());
        } else {
            desk.job.requeue(whole->id); // the parts are all there is of it
            CHECK_FALSE(desk.job.has_pending());
            desk.job.requeue(part->id);
            CHECK(desk.job.has_pending());
        }
        (void)desk.finish(*other);
        while (const auto handed = desk.hand_out(4, 1e9))
            (void)desk.finish(*handed);
        CHECK(desk.job.all_done());
    }
}

TEST_CASE("of a tile that is done in part, what is done is not handed out again") {
    Desk desk{Job(automatic(1, 64, 64), 1, "c")};
    const auto whole = desk.hand_out(1, 1e9);
    desk.job.overbook(whole->id, 2);
    const auto second = desk.hand_out(2, 1e9), first = desk.hand_out(3, 1e9);
    (void)desk.finish(*first);

    SUBCASE("when both workers are lost, and it is cut") {
        desk.job.requeue(second->id); // the whole is still at its worker
        desk.job.requeue(whole->id);
        const auto rest = desk.hand_out(2, 64 * 64 / 2);
        REQUIRE(rest);
        CHECK(rest->tile == second->tile);
    }
    SUBCASE("when others help out once more") {
        desk.job.requeue(second->id);
        REQUIRE(desk.job.can_overbook(whole->id));
        desk.job.overbook(whole->id, 2);
        const auto rest = desk.hand_out(2, 1e9);
        REQUIRE(rest);
        CHECK(rest->tile == second->tile);
        CHECK_FALSE(desk.hand_out(3, 1e9));
    }
}

TEST_CASE("parts of parts can be overbooked, and no more") {
    Desk desk{Job(automatic(1, 64, 64), 1, "c")};
    auto handed = desk.hand_out(1, 1e9);
    int depth = 1;
    while (desk.job.can_overbook(handed->id)) {
        desk.job.overbook(handed->id, 1);
        handed = desk.hand_out(static_cast<std::uint8_t>(++depth), 1e9);
        REQUIRE(handed);
    }
    CHECK(depth == 3);
}

TEST_CASE("the one cell that a worker has is not handed to it once more") {
    SubmitJob s = Farm::picture(1, 1); // one tile
    Desk desk{Job(s, 1, "c")};
    const auto whole = desk.hand_out(1, 1e9);
    desk.job.overbook(whole->id, 4);
    CHECK_FALSE(desk.hand_out(1, 1e9));
    CHECK(desk.hand_out(2, 1e9));
}

TEST_CASE("shares are as large as was asked, of the pixels or of the work") {
    struct Row {
        bool by_work;
        std::vector<double> shares, want; // of the pixels
    };
    for (const Row& row :
         {Row{false, {1, 1, 1, 1}, {.25, .25, .25, .25}}, Row{false, {1, 3}, {.25, .75}},
          // The left half is three times the work of the right.
          Row{true, {1, 1}, {1 / 3.0, 2 / 3.0}}}) {
        CAPTURE(row.by_work);
        Desk desk{Job(automatic(1, 256, 64), 1, "c")};
        desk.job.take_probe(spots_of(desk.job, {3, 3, 1, 1}));
        std::vector<Job::Share> shares;
        for (std::size_t i = 0; i < row.shares.size(); ++i)
            shares.push_back({id_of<WorkerId>(static_cast<std::uint8_t>(1 + i)), row.shares[i]});
        desk.job.deal_out(shares, row.by_work, false);
        for (std::size_t i = 0; i < row.want.size(); ++i) {
            double pixels = 0;
            while (const auto handed = desk.hand_out(static_cast<std::uint8_t>(1 + i), 1e9))
                pixels += static_cast<double>(desk.job.rect(handed->tile).pixel_count());
            CHECK(pixels / (256 * 64) == doctest::Approx(row.want[i]).epsilon(.02));
        }
        CHECK_FALSE(desk.job.has_pending());
    }
}

TEST_CASE("a share is its worker's alone, until that is gone; but thieves may take of it") {
    for (const bool stealing : {false, true}) {
        CAPTURE(stealing);
        Desk desk{Job(automatic(1, 256, 64), 1, "c")};
        desk.job.deal_out({{id_of<WorkerId>(1)}, {id_of<WorkerId>(2)}}, false, stealing);
        const auto own = desk.hand_out(1, 1e9);
        CHECK(desk.job.rect(own->tile).x < 128);
        while (desk.hand_out(1, 1e9)) {
        }
        CHECK(desk.job.has_pending() == !stealing);
        CHECK_FALSE(desk.hand_out(3, 1e9));
        desk.job.release_share(id_of<WorkerId>(2));
        CHECK(desk.hand_out(3, 1e9).has_value() == !stealing);
    }
}

TEST_CASE("what was restored is not handed out, and what is left is") {
    Desk desk{Job(automatic(1, 128, 64), 1, "c")};
    const CellGrid grid = desk.job.grid();
    const auto stored = [&](PixelRect rect) {
        StoredTile tile;
        tile.tile = TileIndex(static_cast<std::uint32_t>(grid.index(*grid.cells(rect))));
        tile.rect = rect;
        tile.rays.camera = rect.pixel_count();
        return tile;
    };
    CHECK(desk.job.restore(stored({0, 0, 64, 64})));
    CHECK(desk.job.restore(stored({64, 0, 32, 2})));
    CHECK_FALSE(desk.job.restore(stored({64, 0, 32, 2}))); // nothing new
    StoredTile wrong = stored({96, 0, 2, 2});
    wrong.tile = TileIndex{0};
    CHECK_FALSE(desk.job.restore(wrong));
    wrong = stored({96, 0, 2, 2});
    wrong.rect.width = 3;
    CHECK_FALSE(desk.job.restore(wrong));
    wrong = stored({96, 0, 2, 2});
    wrong.pass = 1;
    CHECK_FALSE(desk.job.restore(wrong));
    desk.job.phase = JobPhase::queued;
    desk.job.end_restoring();
    std::uint64_t pixels = 0;
    while (const auto handed = desk.hand_out(1, 1e9)) {
        CHECK(desk.job.rect(handed->tile).x >= 64);
        pixels += desk.job.rect(handed->tile).pixel_count();
        (void)desk.finish(*handed);
    }
    CHECK(pixels == 64 * 64 - 64);
    CHECK(desk.job.all_done());
    CHECK(desk.job.state(1, {}).rays.camera == 128 * 64);
}

TEST_CASE("whatever happens to tiles, none is lost and every cell is done in the end") {
    for_each_seed(500, [](Rng& rng) {
        const std::uint32_t side_max = rng.below(4) == 0 ? 400 : 150;
        SubmitJob s = automatic(1, 1 + static_cast<std::uint32_t>(rng.below(side_max)),
                                1 + static_cast<std::uint32_t>(rng.below(side_max)));
        if (rng.below(3) == 0)
            s.tile_side = 8 + static_cast<std::uint32_t>(rng.below(30));
        s.order = static_cast<TileOrder>(rng.below(4));
        Desk desk{Job(s, 1, "c")};
        if (rng.below(2) == 0)
            desk.joined_work_max = 1e9;
        if (rng.below(2) == 0)
            desk.scout_work = 5'000 * rng.unit();
        const auto someone = [&] { return static_cast<std::uint8_t>(1 + rng.below(4)); };
        std::vector<Job::Handed> late; // taken back, and answered all the same
        for (int i = 0; i < 300 && !desk.job.all_done(); ++i) {
            auto at = desk.at_work.begin();
            if (!desk.at_work.empty())
                std::advance(at, static_cast<std::ptrdiff_t>(rng.below(desk.at_work.size())));
            switch (rng.below(8)) {
            case 0:
                if (!late.empty() && !desk.job.all_cells_done(late.back().tile))
                    (void)desk.finish(late.back());
                break;
            case 1:
                if (at != desk.at_work.end() &&
                    desk.job.assigned_as(at->first, at->second.attempt)) {
                    late.push_back(at->second.handed);
                    desk.job.requeue(at->first);
                    desk.at_work.erase(at);
                }
                break;
            case 2:
                if (at != desk.at_work.end() && desk.job.can_overbook(at->first))
                    desk.job.overbook(at->first, 1 + static_cast<std::uint32_t>(rng.below(5)));
                break;
            case 3:
                if (at != desk.at_work.end() && !desk.job.all_cells_done(at->second.handed.tile))
                    (void)desk.finish(Job::Handed(at->second.handed));
                break;
            case 4:
                if (i == 20 && rng.below(2) == 0) {
                    (void)desk.job.drop_unfinished();
                    desk.at_work.clear();
                    desk.job.revive();
                }
                break;
            default:
                (void)desk.hand_out(someone(), rng.unit() * 3'000);
            }
            CHECK(desk.job.in_flight_count() <= desk.at_work.size());
        }
        // Then all goes well.
        for (int i = 0; i < 30'000 && !desk.job.all_done(); ++i) {
            if (!desk.at_work.empty()) {
                const Job::Handed handed = desk.at_work.begin()->second.handed;
                if (desk.job.all_cells_done(handed.tile))
                    desk.at_work.erase(handed.id);
                else
                    (void)desk.finish(handed);
            } else {
                REQUIRE(desk.hand_out(5, 1e9, 0));
            }
        }
        CHECK(desk.job.all_done());
        CHECK(desk.job.in_flight_count() == 0);
        CHECK(desk.job.workers().empty());
        CHECK_FALSE(desk.hand_out(6, 1e9));
        CHECK(desk.job.state(1, {}).done_count == desk.job.grid().count());
        CHECK(desk.job.costs().left() == doctest::Approx(0).scale(1e4));
    });
}

} // namespace
} // namespace fraja::broker
