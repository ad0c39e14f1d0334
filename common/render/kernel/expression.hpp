// What a textured form is made of: a formula over the sides of surfaces.
#pragma once

#include <cstdint>
#include <vector>

namespace fraja::kernel {

/// A formula without negations but those of its literals.
struct Expression {
    enum class Kind : std::uint8_t { never, always, literal, all, any };
    Kind kind = Kind::never;
    std::uint32_t surface = 0; ///< of a literal: true inside it
    bool negated = false;      ///< of a literal: true outside
    std::vector<Expression> parts;

    static Expression constant(bool value);
    static Expression inside(std::uint32_t surface, bool negated);
    /// Simplified: no constants within, no part of its own kind, no literal twice; a literal and
    /// its opposite make it a constant. Of no parts: all is always, any is never.
    static Expression joined(Kind kind, std::vector<Expression> parts);

    /// inside(surface) answers whether the point asked for is inside.
    template <class Inside>
    [[nodiscard]] bool holds(const Inside& is_inside) const {
        switch (kind) {
        case Kind::never:
            return false;
        case Kind::always:
            return true;
        case Kind::literal:
            return is_inside(surface) != negated;
        case Kind::all:
            for (const Expression& part : parts)
                if (!part.holds(is_inside))
                    return false;
            return true;
        case Kind::any:
            for (const Expression& part : parts)
                if (part.holds(is_inside))
                    return true;
            return false;
        }
        return false;
    }
};

} // namespace fraja::kernel
