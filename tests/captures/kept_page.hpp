// The page of a version that was: whether its programs would take a message. It knows nothing of
// the codec but what PROTOCOL.md said then.
#pragma once

#include "common/base/bytes.hpp"

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace fraja {

class KeptPage {
public:
    /// Reads captures / VERSION / PROTOCOL.md.
    explicit KeptPage(unsigned version);

    /// Why a program of that version would refuse header, body and blobs. Empty: it would not.
    [[nodiscard]] std::string complaint(std::span<const Blob> frames) const;
    [[nodiscard]] bool knows(unsigned type) const { return messages_.contains(type); }

    enum class Trim { as_it_was, one_field_less };
    /// The frames as a program of that version would have said them: without what it did not have.
    /// Or without its last field, too; nothing, where it has none.
    [[nodiscard]] std::optional<std::vector<Blob>> trimmed(std::span<const Blob> frames,
                                                           Trim trim = Trim::as_it_was) const;

private:
    struct Field {
        std::string name, type;
    };
    using Fields = std::vector<Field>;

    void check_fields(const Fields& fields, const void* object) const;
    void check(const std::string& type, const void* object) const;
    template <class Packer>
    void copy_fields(Packer& packer, const Fields& fields, std::size_t count,
                     const void* object) const;
    template <class Packer>
    void copy(Packer& packer, const std::string& type, const void* object) const;

    unsigned version_;
    std::map<unsigned, std::string> messages_;   ///< by number
    std::map<std::string, Fields> records_;      ///< messages as well
    std::map<std::string, std::uint64_t> enums_; ///< how many values there are
};

} // namespace fraja
