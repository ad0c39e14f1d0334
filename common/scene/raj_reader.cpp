#include "common/scene/raj_reader.hpp"

#include "common/base/assert.hpp"
#include "common/base/missing_file.hpp"
#include "common/base/text.hpp"
#include "common/scene/raj_builder.hpp"
#include "common/scene/raj_labels.hpp"
#include "common/scene/raj_lexer.hpp"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <fstream>
#include <iterator>
#include <system_error>
#include <utility>

namespace fraja {
namespace raj {
namespace {

constexpr std::string_view value_expected = "a number, a label, an object, a list or a graph";

/// Recursive descent along the grammar of FORMAT.md 1.2. Every function is false when something
/// has been refused; the token that a function has taken in is the last one of its rule.
class Parser {
public:
    Parser(std::string_view text, const RajLimits& limits, Diagnostics& diagnostics)
        : limits_(limits), diagnostics_(diagnostics), lexer_(text, limits, diagnostics),
          builder_(limits, diagnostics), labels_(limits, diagnostics) {}

    bool parse_file(Scene& scene);
    bool parse_cameras(std::vector<Camera>& cameras);

private:
    bool parse_value(FieldValue& field);
    bool parse_object(Value& object);
    bool parse_head(ObjectHead& head);
    bool parse_fields(const ObjectHead& head, FieldValues& fields);
    bool parse_numbers(const ObjectHead& head, std::array<Value, 3>& numbers);
    bool parse_number(Value& number);
    bool parse_list(std::vector<Value>& items);
    bool parse_graph(std::vector<Value>& nodes);
    bool parse_label(Value& value);

    void advance() { token_ = lexer_.next(); }
    bool expected(std::string_view what, std::optional<std::string_view> meant = {});
    bool expect(TokenKind kind, std::string_view what);
    bool add_item(std::vector<Value>& items, const Value& item, std::size_t values_per_item);

    const RajLimits& limits_;
    Diagnostics& diagnostics_;
    Lexer lexer_;
    Builder builder_;
    Labels labels_;
    Token token_;
    std::uint64_t depth_ = 0;
};

bool Parser::parse_file(Scene& scene) {
    advance();
    FieldValue file;
    if (!parse_value(file))
        return false;
    if (file.value.kind != Kind::scene)
        return diagnostics_.refuse(file.value.place,
                                   "the file must hold a raja.renderer.Scene, not " +
                                       std::string(name_of(file.value.kind)));
    scene = builder_.take_scene(file.value);
    return true;
}

bool Parser::parse_cameras(std::vector<Camera>& cameras) {
    constexpr std::string_view cure = "a travel is a list of cameras: [ camera, camera, ... ]";
    advance();
    FieldValue file;
    if (!parse_value(file))
        return false;
    if (file.value.kind != Kind::list)
        return diagnostics_.refuse(file.value.place, std::string(cure) + ", not " +
                                                         std::string(name_of(file.value.kind)));
    if (file.items.empty())
        return diagnostics_.refuse(file.value.place, std::string(cure) + "; there is none in it");
    for (const Value& item : file.items) {
        if (item.kind != Kind::camera)
            return diagnostics_.refuse(item.place, std::string(cure) + ", and here is " +
                                                       std::string(name_of(item.kind)));
        cameras.push_back(builder_.camera(item));
    }
    return true;
}

bool Parser::expected(std::string_view what, std::optional<std::string_view> meant) {
    const std::string expectation = "expected " + std::string(what);
    if (token_.kind == TokenKind::end)
        return diagnostics_.refuse(token_.place, "unexpected end of the file: " + expectation);
    return diagnostics_.refuse(token_.place,
                               expectation + ", found " + describe(token_) + did_you_mean(meant));
}

/// The present token must be of that kind.
bool Parser::expect(TokenKind kind, std::string_view what) {
    return token_.kind == kind || expected(what);
}

bool Parser::parse_value(FieldValue& field) {
    field.given = true;
    field.items.clear();
    field.value.place = token_.place;
    switch (token_.kind) {
    case TokenKind::number:
        return parse_number(field.value);
    case TokenKind::label:
        return parse_label(field.value);
    case TokenKind::class_name:
        return parse_object(field.value);
    case TokenKind::open_list:
        field.value.kind = Kind::list;
        return parse_list(field.items);
    case TokenKind::open_graph:
        field.value.kind = Kind::graph;
        return parse_graph(field.items);
    default:
        return expected(value_expected, nearest_class(token_.text));
    }
}

bool Parser::parse_object(Value& object) {
    ObjectHead head;
    if (!parse_head(head))
        return false;
    if (depth_ >= limits_.nesting)
        return diagnostics_.refuse_limit(head.place, "nesting", limits_.nesting,
                                         "objects within one another");
    ++depth_;
    if (!head.label.empty())
        labels_.open(head.label);
    if (head.spec->number_count > 0) {
        std::array<Value, 3> numbers;
        if (!parse_numbers(head, numbers) || !builder_.build_from_numbers(head, numbers, object))
            return false;
    } else {
        FieldValues fields;
        if (!parse_fields(head, fields) || !builder_.build_from_fields(head, fields, object))
            return false;
    }
    --depth_;
    return head.label.empty() || labels_.close(head.label, object);
}

/// class [ "(" label ")" ], and the brace that opens the body.
bool Parser::parse_head(ObjectHead& head) {
    head.place = token_.place;
    head.spec = find_class(token_.text);
    if (!head.spec)
        return diagnostics_.refuse(token_.place, "there is no class " + quoted(token_.text) +
                                                     did_you_mean(nearest_class(token_.text)));
    advance();
    if (token_.kind == TokenKind::open_paren) {
        advance();
        if (!expect(TokenKind::label, "a label (@name)"))
            return false;
        head.label = token_.text;
        advance();
        if (!expect(TokenKind::close_paren, "')'"))
            return false;
        advance();
        return expect(TokenKind::open_brace, "'{'");
    }
    return expect(TokenKind::open_brace, "'(' or '{'");
}

bool Parser::parse_fields(const ObjectHead& head, FieldValues& fields) {
    for (advance(); token_.kind != TokenKind::close_brace; advance()) {
        const bool is_capital_name = // for which only a field can have been meant
            token_.kind == TokenKind::class_name && token_.text.find('.') == std::string_view::npos;
        const bool is_name = token_.kind == TokenKind::field || is_capital_name;
        const auto spec = std::ranges::find(head.spec->fields, token_.text, &FieldSpec::name);
        if (is_name && spec == head.spec->fields.end())
            return diagnostics_.refuse(token_.place,
                                       std::string(head.spec->name) + " has no field " +
                                           quoted(token_.text) +
                                           did_you_mean(nearest_field(*head.spec, token_.text)));
        if (!is_name)
            return expected("a field of " + std::string(head.spec->name) + " or '}'");
        advance();
        if (!expect(TokenKind::equals, "'='"))
            return false;
        advance();
        if (!parse_value(fields[static_cast<std::size_t>(spec - head.spec->fields.begin())]))
            return false;
    }
    return true;
}

bool Parser::parse_numbers(const ObjectHead& head, std::array<Value, 3>& numbers) {
    for (std::size_t i = 0; i < head.spec->number_count; ++i) {
        if (i > 0 && !expect(TokenKind::semicolon, "';'"))
            return false;
        advance();
        if (!expect(TokenKind::number, "a number") || !parse_number(numbers[i]))
            return false;
        advance();
    }
    return expect(TokenKind::close_brace, "'}'");
}

bool Parser::parse_number(Value& number) {
    number = {.number = 0, .index = 0, .place = token_.place, .kind = Kind::number};
    const std::string_view text = token_.text;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number.number,
                                              std::chars_format::fixed);
    if (error == std::errc::result_out_of_range) {
        // Too large or too small? What has no digit before the point but zeros is small.
        const std::size_t first = text.find_first_not_of("-0");
        if (first != std::string_view::npos && text[first] != '.')
            return diagnostics_.refuse(token_.place, quoted(text) + " is too large for a number");
        number.number = text[0] == '-' ? -0.0 : 0.0;
    }
    FRAJA_ASSERT(error == std::errc::result_out_of_range ||
                 (error == std::errc{} && end == text.data() + text.size()));
    return true;
}

bool Parser::parse_list(std::vector<Value>& items) {
    advance();
    if (token_.kind == TokenKind::close_list)
        return true;
    for (;; advance()) {
        Value item;
        item.place = token_.place;
        const bool read = token_.kind == TokenKind::label        ? parse_label(item)
                          : token_.kind == TokenKind::class_name ? parse_object(item)
                                                                 : expected("a label or an object");
        if (!read || !add_item(items, item, 1))
            return false;
        advance();
        if (token_.kind == TokenKind::close_list)
            return true;
        if (!expect(TokenKind::comma, "',' or ']'"))
            return false;
    }
}

bool Parser::parse_graph(std::vector<Value>& nodes) {
    advance();
    if (token_.kind == TokenKind::close_graph)
        return true;
    for (;; advance()) {
        Value above, below;
        if (!expect(TokenKind::label, "a label (@name)") || !parse_label(above))
            return false;
        advance();
        if (!expect(TokenKind::over, "'>>'"))
            return false;
        advance();
        if (!expect(TokenKind::label, "a label (@name)") || !parse_label(below))
            return false;
        if (!add_item(nodes, above, 2) || !add_item(nodes, below, 2))
            return false;
        advance();
        if (token_.kind == TokenKind::close_graph)
            return true;
        if (!expect(TokenKind::comma, "',' or ']]'"))
            return false;
    }
}

bool Parser::add_item(std::vector<Value>& items, const Value& item, std::size_t values_per_item) {
    if (items.size() / values_per_item >= limits_.list_items)
        return diagnostics_.refuse_limit(item.place, "list_items", limits_.list_items,
                                         "items in one list or graph");
    items.push_back(item);
    return true;
}

bool Parser::parse_label(Value& value) {
    if (!labels_.find(token_.text, token_.place, value))
        return false;
    value.place = token_.place; // where it is used, not where it was defined
    return true;
}

} // namespace
} // namespace raj

namespace {

constexpr std::size_t read_chunk_bytes = std::size_t{1} << 20;

Error too_large(std::string_view file_name, const RajLimits& limits) {
    return {ErrorCode::limit_exceeded, std::string(file_name) + ": more than " +
                                           std::to_string(limits.bytes) + " bytes (limit 'bytes')"};
}

/// Pipes have no size, so the bytes are counted as they come.
Result<std::string> read_text(const std::filesystem::path& path, const RajLimits& limits) {
    const auto io_error = [&](std::string_view what) {
        return Error{ErrorCode::io, path.string() + ": " + std::string(what)};
    };
    std::error_code error;
    const auto status = std::filesystem::status(path, error);
    if (status.type() == std::filesystem::file_type::not_found)
        return Error{ErrorCode::io, missing_file(path, ".raj")};
    if (error)
        return io_error(error.message());
    if (std::filesystem::is_directory(status))
        return io_error("this is a directory, not a scene file");
    std::ifstream file(path, std::ios::binary);
    if (!file)
        return io_error(std::strerror(errno));

    std::string text;
    const auto size = std::filesystem::file_size(path, error);
    if (!error && size > limits.bytes)
        return too_large(path.string(), limits);
    if (!error)
        text.reserve(static_cast<std::size_t>(size));
    std::vector<char> chunk(read_chunk_bytes);
    while (file) {
        file.read(chunk.data(), static_cast<std::streamsize>(chunk.size()));
        text.append(chunk.data(), static_cast<std::size_t>(file.gcount()));
        if (text.size() > limits.bytes)
            return too_large(path.string(), limits);
    }
    if (file.bad())
        return io_error("cannot be read");
    return text;
}

template <class T>
Result<T> read_by(std::string_view text, std::string_view file_name, const RajLimits& limits,
                  std::vector<std::string>* warnings, bool (raj::Parser::*parse)(T&)) {
    for (const std::uint64_t limit :
         {limits.bytes, limits.token_bytes, limits.list_items, limits.labels, limits.solids,
          limits.nesting, limits.expanded_parts})
        FRAJA_ASSERT(limit <= UINT32_MAX);
    if (text.size() > limits.bytes)
        return too_large(file_name, limits);
    raj::Diagnostics diagnostics(text, file_name);
    T read;
    raj::Parser parser(text, limits, diagnostics);
    const bool good = (parser.*parse)(read);
    if (warnings)
        std::ranges::move(diagnostics.take_warnings(), std::back_inserter(*warnings));
    if (!good)
        return *diagnostics.error();
    return read;
}

} // namespace

Result<Scene> read_raj(std::string_view text, std::string_view file_name, const RajLimits& limits,
                       std::vector<std::string>* warnings) {
    return read_by<Scene>(text, file_name, limits, warnings, &raj::Parser::parse_file);
}

Result<Scene> read_raj_file(const std::filesystem::path& path, const RajLimits& limits,
                            std::vector<std::string>* warnings) {
    const Result<std::string> text = read_text(path, limits);
    if (!text)
        return text.error();
    return read_raj(*text, path.string(), limits, warnings);
}

Result<std::vector<Camera>> read_raj_cameras(std::string_view text, std::string_view file_name,
                                             const RajLimits& limits) {
    return read_by<std::vector<Camera>>(text, file_name, limits, nullptr,
                                        &raj::Parser::parse_cameras);
}

Result<std::vector<Camera>> read_raj_cameras_file(const std::filesystem::path& path,
                                                  const RajLimits& limits) {
    const Result<std::string> text = read_text(path, limits);
    if (!text)
        return text.error();
    return read_raj_cameras(*text, path.string(), limits);
}

} // namespace fraja
