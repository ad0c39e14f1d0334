#include "common/render/kernel/expression.hpp"

#include <algorithm>
#include <iterator>
#include <utility>

namespace fraja::kernel {
namespace {

using Kind = Expression::Kind;

bool is_literal(const Expression& e) {
    return e.kind == Kind::literal;
}
bool before(const Expression& a, const Expression& b) {
    return std::pair(a.surface, a.negated) < std::pair(b.surface, b.negated);
}
bool same(const Expression& a, const Expression& b) {
    return a.surface == b.surface && a.negated == b.negated;
}
bool opposite(const Expression& a, const Expression& b) {
    return a.surface == b.surface && a.negated != b.negated;
}

} // namespace

Expression Expression::constant(bool value) {
    Expression e;
    e.kind = value ? Kind::always : Kind::never;
    return e;
}

Expression Expression::inside(std::uint32_t surface, bool negated) {
    Expression e;
    e.kind = Kind::literal;
    e.surface = surface;
    e.negated = negated;
    return e;
}

Expression Expression::joined(Kind kind, std::vector<Expression> parts) {
    const Kind neutral = kind == Kind::all ? Kind::always : Kind::never;
    const Kind decisive = kind == Kind::all ? Kind::never : Kind::always;
    std::vector<Expression> flat;
    for (Expression& part : parts) {
        if (part.kind == decisive)
            return constant(decisive == Kind::always);
        if (part.kind == neutral)
            continue;
        if (part.kind == kind)
            std::move(part.parts.begin(), part.parts.end(), std::back_inserter(flat));
        else
            flat.push_back(std::move(part));
    }
    const auto literals_end = std::stable_partition(flat.begin(), flat.end(), is_literal);
    std::sort(flat.begin(), literals_end, before);
    flat.erase(std::unique(flat.begin(), literals_end, same), literals_end);
    const auto end = std::find_if_not(flat.begin(), flat.end(), is_literal);
    if (std::adjacent_find(flat.begin(), end, opposite) != end)
        return constant(decisive == Kind::always);
    if (flat.empty())
        return constant(neutral == Kind::always);
    if (flat.size() == 1)
        return std::move(flat.front());
    Expression e;
    e.kind = kind;
    e.parts = std::move(flat);
    return e;
}

} // namespace fraja::kernel
