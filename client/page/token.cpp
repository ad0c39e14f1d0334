#include "client/page/token.hpp"

#include <algorithm>
#include <array>
#include <fstream>
#include <sodium.h>
#include <system_error>

namespace fraja::client {
namespace {

constexpr int token_alphabet = sodium_base64_VARIANT_URLSAFE_NO_PADDING;
constexpr std::size_t token_bytes = 32;

bool is_token_char(char c) {
    return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '-' ||
           c == '_';
}

} // namespace

std::string fresh_token() {
    FRAJA_ASSERT(sodium_init() >= 0);
    std::array<unsigned char, token_bytes> random{};
    randombytes_buf(random.data(), random.size());
    std::array<char, sodium_base64_ENCODED_LEN(token_bytes, token_alphabet)> text{};
    sodium_bin2base64(text.data(), text.size(), random.data(), random.size(), token_alphabet);
    return text.data();
}

Result<std::string> read_token(const std::filesystem::path& path) {
    namespace fs = std::filesystem;
    const auto failed = [&](ErrorCode code, const std::string& why) {
        return Error{code, "--token-file " + path.string() + ": " + why};
    };
    std::error_code ec;
    const fs::file_status status = fs::status(path, ec);
    if (status.type() == fs::file_type::not_found)
        return failed(ErrorCode::io, "there is no such file; to make one, type: (umask 077; head "
                                     "-c 24 /dev/urandom | base64 | tr +/ -_ > " +
                                         path.string() + ")");
    if (ec)
        return failed(ErrorCode::io, ec.message());
    constexpr fs::perms others = fs::perms::group_all | fs::perms::others_all;
    if ((status.permissions() & others) != fs::perms::none)
        return failed(ErrorCode::invalid_argument,
                      "others may use it; type: chmod 600 " + path.string());
    std::ifstream file(path);
    std::string token;
    if (!std::getline(file, token))
        return failed(ErrorCode::io, "cannot be read, or is empty");
    if (token.size() < token_chars_min || token.size() > token_chars_max ||
        !std::ranges::all_of(token, is_token_char))
        return failed(ErrorCode::invalid_argument,
                      "a token is " + std::to_string(token_chars_min) + " to " +
                          std::to_string(token_chars_max) +
                          " letters, digits, - and _ on the first line");
    return token;
}

bool is_same_token(std::string_view a, std::string_view b) {
    return a.size() == b.size() && sodium_memcmp(a.data(), b.data(), a.size()) == 0;
}

} // namespace fraja::client
