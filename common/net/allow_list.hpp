// AllowList: whose keys are known, and what each is for.
//
//     # ROLE[,ROLE] PUBLIC-KEY NAME
//     workers       F=7..40 characters..  render farm
//     worker        k8T..40 characters..  a guest's machine
//     submit,admin  rq:M..40 characters.. ada
//
// `workers` is the role `worker`, and says that many machines of one owner have the key.
#pragma once

#include "common/base/result.hpp"
#include "common/net/keys.hpp"
#include "common/protocol/roles.hpp"

#include <cstddef>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <unordered_map>

namespace fraja::net {

inline constexpr std::size_t allow_entries_max = 100'000;
inline constexpr std::size_t allow_line_bytes_max = 1'000;
inline constexpr std::size_t allow_file_bytes_max = std::size_t{32} << 20;

class AllowList {
public:
    using Holder = std::shared_ptr<const protocol::KeyHolder>;

    /// Errors: invalid_argument and limit_exceeded, with `file` and line.
    [[nodiscard]] static Result<AllowList> parse(std::string_view text, const std::string& file);
    /// Besides: io, and of a file that is neither the caller's nor root's, or that others than its
    /// owner may write to, with the cure.
    [[nodiscard]] static Result<AllowList> read(const std::filesystem::path& file);

    /// Another broker of the same farm has the same key.
    void add_brokers(const PublicKey& own);
    /// Null: nobody has it.
    [[nodiscard]] Holder find(const std::string& key) const;
    [[nodiscard]] std::size_t size() const { return holders_.size(); }
    [[nodiscard]] std::map<std::string, protocol::Roles> roles() const;
    /// Whether somebody who is listed here, and may follow the stream, may not by `later`.
    [[nodiscard]] bool followers_lost_in(const AllowList& later) const;

private:
    std::unordered_map<std::string, Holder> holders_;
};

} // namespace fraja::net
