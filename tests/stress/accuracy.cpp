// accuracy [CASES]: the errors of the fast kernel's hits, regime by regime, beside their marks.
#include "common/base/text.hpp"
#include "tests/stress/solid_cases.hpp"
#include "tests/stress/surface_cases.hpp"

#include <cstdio>
#include <string>

int main(int argc, char** argv) {
    using namespace fraja;
    const auto cases = parse_count(argc > 1 ? argv[1] : "200000");
    if (!cases || argc > 2) {
        std::fprintf(stderr, "accuracy [CASES]\n");
        return 2;
    }
    std::printf("%llu cases each, greatest errors in eps = 2^-53 (mark)\n",
                static_cast<unsigned long long>(*cases));
    std::printf("%-46s %8s %16s %16s %16s\n", "", "missed", "t", "place / scale", "normal");
    bool good = true;
    const auto cell = [&](double value, double mark) {
        good &= mark == 0 || value <= mark;
        char text[40];
        if (mark > 0)
            std::snprintf(text, sizeof text, "%.3g (%g)%s", value, mark, value <= mark ? "" : " !");
        else
            std::snprintf(text, sizeof text, "%.3g", value);
        std::printf(" %16s", text);
    };
    for (const stress::Regime& regime : stress::surface_regimes()) {
        Rng rng(1);
        const stress::Errors e = regime.run(rng, *cases);
        std::printf("%-46s %8llu", regime.name.c_str(), static_cast<unsigned long long>(e.missed));
        cell(e.t, regime.marks.t);
        cell(e.place, regime.marks.place);
        cell(e.normal, regime.marks.normal);
        std::printf("\n");
        good &= e.missed == 0;
    }
    std::printf("\n%-46s %8s %10s %8s %8s\n", "solids along rays, against exact evaluation", "wrong",
                "changes", "entries", "grazing");
    for (const stress::SolidRegime& regime : stress::solid_regimes()) {
        Rng rng(1);
        const stress::Walks w = regime.run(rng, *cases);
        std::printf("%-46s %8llu %10llu %8llu %8llu\n", regime.name.c_str(),
                    static_cast<unsigned long long>(w.wrong),
                    static_cast<unsigned long long>(w.changes),
                    static_cast<unsigned long long>(w.wrong_entries),
                    static_cast<unsigned long long>(w.grazing));
        good &= w.wrong + w.wrong_entries == 0;
    }
    return good ? 0 : 1;
}
