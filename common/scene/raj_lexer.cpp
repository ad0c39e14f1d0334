#include "common/scene/raj_lexer.hpp"

#include <algorithm>

namespace fraja::raj {
namespace {

bool is_small(char c) {
    return c >= 'a' && c <= 'z';
}
bool is_capital(char c) {
    return c >= 'A' && c <= 'Z';
}
bool is_digit(char c) {
    return c >= '0' && c <= '9';
}
bool is_word(char c) {
    return is_small(c) || is_capital(c) || is_digit(c) || c == '_';
}
bool is_small_or_digit(char c) {
    return is_small(c) || is_digit(c);
}
bool is_word_or_dot(char c) {
    return is_word(c) || c == '.';
}
/// Raja takes letters of all scripts in labels; so do we, without asking which are letters.
bool is_label(char c) {
    return is_word_or_dot(c) || static_cast<unsigned char>(c) >= 0x80;
}

} // namespace

std::string describe(const Token& token) {
    if (token.kind == TokenKind::end)
        return "the end of the file";
    if (token.text == "\xEF\xBB\xBF")
        return "a byte order mark";
    return quoted(token.text);
}

Token Lexer::next() {
    skip_blanks_and_comments();
    const Place place{static_cast<std::uint32_t>(position_), line_};
    if (position_ == text_.size())
        return {TokenKind::end, place, {}};
    TokenKind kind = TokenKind::bad;
    const std::size_t end = scan(kind);
    const std::string_view text = text_.substr(position_, end - position_);
    position_ = end;
    if (text.size() > token_bytes_max_) {
        diagnostics_.refuse_limit(place, "token_bytes", token_bytes_max_,
                                  "bytes in one name or number");
        return {TokenKind::bad, place, text};
    }
    return {kind, place, text};
}

void Lexer::skip_blanks_and_comments() {
    for (; position_ < text_.size(); ++position_) {
        const char c = text_[position_];
        if (c == '\n' || (c == '\r' && at(position_ + 1) != '\n')) {
            ++line_;
        } else if (c == '/' && at(position_ + 1) == '/') {
            position_ = std::min(text_.size(), text_.find_first_of("\r\n", position_));
            --position_; // the line's end counts the line
        } else if (c != ' ' && c != '\t' && c != '\r') {
            return;
        }
    }
}

template <class Belongs>
std::size_t Lexer::run_end(std::size_t i, Belongs belongs) const {
    while (i < text_.size() && belongs(text_[i]))
        ++i;
    return i;
}

/// The end of the token at position_, at least one byte on.
std::size_t Lexer::scan(TokenKind& kind) const {
    const char c = text_[position_];
    if (is_small(c))
        return scan_small_name(kind);
    if (is_digit(c) || c == '-' || c == '.')
        return scan_number(kind);
    if (is_capital(c)) {
        kind = TokenKind::class_name;
        return run_end(position_ + 1, is_word);
    }
    if (c == '@') {
        kind = TokenKind::label;
        return run_end(position_ + 1, is_label);
    }
    return scan_sign(kind);
}

std::size_t Lexer::scan_number(TokenKind& kind) const {
    const std::size_t start = position_ + (text_[position_] == '-' ? 1 : 0);
    std::size_t end = run_end(start, is_digit);
    std::size_t digits = end - start;
    if (at(end) == '.') {
        const std::size_t fraction_end = run_end(end + 1, is_digit);
        digits += fraction_end - (end + 1);
        end = fraction_end;
    }
    kind = digits > 0 ? TokenKind::number : TokenKind::bad;
    return end;
}

/// A field, or a class with its package. A dot after the leading small letters and digits decides.
std::size_t Lexer::scan_small_name(TokenKind& kind) const {
    const std::size_t leading_end = run_end(position_, is_small_or_digit);
    if (at(leading_end) != '.') {
        kind = TokenKind::field;
        return run_end(leading_end, is_word);
    }
    const std::size_t package_end =
        run_end(leading_end, [](char c) { return is_small(c) || c == '.'; });
    if (is_capital(at(package_end))) {
        kind = TokenKind::class_name;
        return run_end(package_end, is_word);
    }
    kind = TokenKind::bad;
    return run_end(package_end, is_word_or_dot);
}

std::size_t Lexer::scan_sign(TokenKind& kind) const {
    const char c = text_[position_];
    const bool twice = at(position_ + 1) == c;
    switch (c) {
    case ',':
        kind = TokenKind::comma;
        return position_ + 1;
    case ';':
        kind = TokenKind::semicolon;
        return position_ + 1;
    case '=':
        kind = TokenKind::equals;
        return position_ + 1;
    case '(':
        kind = TokenKind::open_paren;
        return position_ + 1;
    case ')':
        kind = TokenKind::close_paren;
        return position_ + 1;
    case '{':
        kind = TokenKind::open_brace;
        return position_ + 1;
    case '}':
        kind = TokenKind::close_brace;
        return position_ + 1;
    case '[':
        kind = twice ? TokenKind::open_graph : TokenKind::open_list;
        return position_ + (twice ? 2 : 1);
    case ']':
        kind = twice ? TokenKind::close_graph : TokenKind::close_list;
        return position_ + (twice ? 2 : 1);
    case '>':
        kind = twice ? TokenKind::over : TokenKind::bad;
        return position_ + (twice ? 2 : 1);
    default: // a character of several bytes is one fault
        kind = TokenKind::bad;
        return run_end(position_ + 1,
                       [](char b) { return (static_cast<unsigned char>(b) & 0xc0) == 0x80; });
    }
}

} // namespace fraja::raj
