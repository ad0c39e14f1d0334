#include "common/render/kernel/expression.hpp"

#include "tests/support/seeds.hpp"

#include <doctest/doctest.h>

namespace fraja::kernel {
namespace {

using Kind = Expression::Kind;

TEST_CASE("of no parts, all is always and any is never") {
    CHECK(Expression::joined(Kind::all, {}).kind == Kind::always);
    CHECK(Expression::joined(Kind::any, {}).kind == Kind::never);
}

TEST_CASE("a literal and its opposite make a constant, twice the same is once") {
    const auto a = Expression::inside(3, false), not_a = Expression::inside(3, true);
    CHECK(Expression::joined(Kind::all, {a, not_a}).kind == Kind::never);
    CHECK(Expression::joined(Kind::any, {a, not_a}).kind == Kind::always);
    const Expression once = Expression::joined(Kind::any, {a, a});
    CHECK(once.kind == Kind::literal);
    CHECK(once.surface == 3);
}

/// As joined() would be, were it simple.
struct Plain {
    Kind kind;
    std::vector<Expression> parts;
    template <class Inside>
    bool holds(const Inside& inside) const {
        for (const Expression& part : parts)
            if (part.holds(inside) != (kind == Kind::all))
                return kind != Kind::all;
        return kind == Kind::all;
    }
};

Expression random_expression(Rng& rng, int depth) {
    const std::uint64_t what = rng.below(8);
    if (what == 0)
        return Expression::constant(rng.below(2) == 0);
    if (depth == 0 || what < 4)
        return Expression::inside(static_cast<std::uint32_t>(rng.below(5)), rng.below(2) == 0);
    std::vector<Expression> parts;
    for (std::uint64_t n = rng.below(4); n > 0; --n)
        parts.push_back(random_expression(rng, depth - 1));
    return Expression::joined(what < 6 ? Kind::all : Kind::any, parts);
}

TEST_CASE("simplifying changes no answer") {
    for_each_seed(2'000, [](Rng& rng) {
        std::vector<Expression> parts;
        for (std::uint64_t n = rng.below(4); n > 0; --n)
            parts.push_back(random_expression(rng, 3));
        const Kind kind = rng.below(2) == 0 ? Kind::all : Kind::any;
        const Plain plain{kind, parts};
        const Expression joined = Expression::joined(kind, parts);
        for (unsigned bits = 0; bits < 32; ++bits) {
            const auto inside = [&](std::uint32_t surface) { return (bits >> surface & 1) != 0; };
            CHECK(joined.holds(inside) == plain.holds(inside));
        }
    });
}

} // namespace
} // namespace fraja::kernel
