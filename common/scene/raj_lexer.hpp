// Tokens of a .raj text (FORMAT.md 1.1).
#pragma once

#include "common/scene/raj_diagnostics.hpp"
#include "common/scene/raj_limits.hpp"

#include <cstdint>
#include <string>
#include <string_view>

namespace fraja::raj {

enum class TokenKind : std::uint8_t {
    end, ///< of the text
    bad, ///< what no token is
    class_name,
    field,
    label, ///< with its '@'
    number,
    comma,
    semicolon,
    equals,
    open_paren,
    close_paren,
    open_brace,
    close_brace,
    open_list,
    close_list,
    open_graph,
    close_graph,
    over, ///< >>
};

struct Token {
    TokenKind kind = TokenKind::end;
    Place place;
    std::string_view text; ///< within the text that is read
};

/// What a message calls the token: 'radiu', or the end of the file.
[[nodiscard]] std::string describe(const Token& token);

/// Cuts a text into tokens, each the longest possible. Linear in the text, no allocation.
class Lexer {
public:
    /// `text` and `diagnostics` must outlive this.
    Lexer(std::string_view text, const RajLimits& limits, Diagnostics& diagnostics)
        : text_(text), token_bytes_max_(limits.token_bytes), diagnostics_(diagnostics) {}

    /// The next token; at the end of the text, `end` for ever. A token beyond limits.token_bytes is
    /// refused and `bad`.
    [[nodiscard]] Token next();

private:
    [[nodiscard]] char at(std::size_t i) const { return i < text_.size() ? text_[i] : '\0'; }
    void skip_blanks_and_comments();
    template <class Belongs>
    [[nodiscard]] std::size_t run_end(std::size_t i, Belongs belongs) const;
    [[nodiscard]] std::size_t scan(TokenKind& kind) const;
    [[nodiscard]] std::size_t scan_number(TokenKind& kind) const;
    [[nodiscard]] std::size_t scan_small_name(TokenKind& kind) const;
    [[nodiscard]] std::size_t scan_sign(TokenKind& kind) const;

    std::string_view text_;
    std::uint64_t token_bytes_max_;
    Diagnostics& diagnostics_;
    std::size_t position_ = 0;
    std::uint32_t line_ = 1;
};

} // namespace fraja::raj
