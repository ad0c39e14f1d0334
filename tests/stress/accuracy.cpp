// accuracy [CASES]: how right the fast kernel's hits and pictures are, beside their marks.
#include "common/base/text.hpp"
#include "tests/stress/picture_cases.hpp"
#include "tests/stress/solid_cases.hpp"
#include "tests/stress/surface_cases.hpp"

#include <algorithm>
#include <cstdio>
#include <string>

namespace fraja::stress {
namespace {

class Table {
public:
    explicit Table(std::uint64_t cases) : cases_(cases) {}

    void surfaces() {
        std::printf("%llu cases each; greatest errors in eps = 2^-53 (mark)\n", number(cases_));
        std::printf("%-52s %8s %16s %16s %16s\n", "hits, against quadruple precision", "missed",
                    "t", "place / scale", "normal");
        for (const Regime& regime : surface_regimes()) {
            Rng rng(1);
            const Errors e = regime.run(rng, cases_);
            std::printf("%-52s %8llu", regime.name.c_str(), number(e.missed));
            bool good = e.missed == 0;
            good &= cell(e.t, regime.marks.t);
            good &= cell(e.place, regime.marks.place);
            good &= cell(e.normal, regime.marks.normal);
            verdict(good);
        }
        Rng entry_rng(1);
        const std::uint64_t differ = entries_that_differ(entry_rng, cases_);
        std::printf("%-52s %8llu %50s", "entries: short and general formula differ", number(differ),
                    "");
        verdict(differ == 0);
        Rng rng(1);
        const std::uint64_t rays = std::max<std::uint64_t>(cases_ / 10, 15);
        const std::uint64_t left = rays_that_leave_a_mirror_ball(rng, rays);
        std::printf("500 bounces, 15 mirror balls: of %8llu rays leave   %8llu %50s", number(rays),
                    number(left), "");
        verdict(left == 0);
    }

    void solids() {
        std::printf("\n%-52s %8s %16s %16s %16s\n", "solids, against exact evaluation", "wrong",
                    "of changes", "wrong entries", "grazing");
        for (const SolidRegime& regime : solid_regimes()) {
            Rng rng(1);
            const Walks w = regime.run(rng, cases_);
            std::printf("%-52s %8llu %16llu %16llu %16llu", regime.name.c_str(), number(w.wrong),
                        number(w.changes), number(w.wrong_entries), number(w.grazing));
            verdict(w.wrong + w.wrong_entries == 0);
        }
    }

    void pictures(bool quick) {
        std::printf("\n%-52s %8s %16s\n", "pictures", "", "(mark)");
        const auto figures = quick ? picture_figures({64, 48}, {160, 120}, cases_ / 10)
                                   : picture_figures({160, 120}, {640, 480}, cases_ / 10);
        for (const Figure& figure : figures) {
            char mark[40];
            std::snprintf(mark, sizeof mark, "(%.3g)", figure.mark);
            std::printf("%-52s %8.3g %16s %33s", figure.name.c_str(), figure.value, mark, "");
            verdict(figure.value <= figure.mark);
        }
    }

    [[nodiscard]] bool good() const { return good_; }

private:
    static unsigned long long number(std::uint64_t n) { return n; }
    static bool cell(double value, double mark) {
        char text[40] = "-";
        if (mark > 0)
            std::snprintf(text, sizeof text, "%.3g (%g)", value, mark);
        else if (value > 0)
            std::snprintf(text, sizeof text, "%.3g", value);
        std::printf(" %16s", text);
        return mark == 0 || value <= mark;
    }
    void verdict(bool good) {
        std::printf("  %s\n", good ? "ok" : "MISSED");
        std::fflush(stdout);
        good_ &= good;
    }

    std::uint64_t cases_;
    bool good_ = true;
};

} // namespace
} // namespace fraja::stress

int main(int argc, char** argv) {
    using namespace fraja;
    const auto cases = parse_count(argc > 1 ? argv[1] : "200000");
    if (!cases || *cases == 0 || argc > 2) {
        std::fprintf(stderr, "accuracy [CASES]\n");
        return 2;
    }
    stress::Table table(*cases);
    table.surfaces();
    table.solids();
    table.pictures(*cases < 100'000);
    std::printf("\n%s\n", table.good() ? "all marks are met" : "a mark is MISSED");
    return table.good() ? 0 : 1;
}
