#include "common/base/bytes.hpp"

#include <doctest/doctest.h>

using namespace fraja;

TEST_CASE("a blob is its bytes, and stays as long as a copy of it") {
    CHECK(Blob().empty());
    CHECK(Blob() == Blob(Bytes{}));
    Blob blob(to_bytes("abc"));
    const Blob copy = blob;
    CHECK(copy.data() == blob.data());
    blob = Blob(to_bytes("abd"));
    CHECK(as_text(copy) == "abc");
    CHECK(copy == Blob(to_bytes("abc")));
    CHECK_FALSE(copy == blob);
    CHECK_FALSE(copy == Blob(to_bytes("ab")));
}

TEST_CASE("a blob may be a part of what another owner holds") {
    auto owner = std::make_shared<const Bytes>(to_bytes("header body"));
    const std::weak_ptr<const Bytes> life = owner;
    Blob part(owner, std::span(*owner).subspan(7));
    owner.reset();
    CHECK(as_text(part) == "body");
    part = Blob();
    CHECK(life.expired());
}

TEST_CASE("blobs are counted and joined in their order; a single one is not copied") {
    const std::vector<Blob> some = {Blob(to_bytes("a")), Blob(), Blob(to_bytes("bcd"))};
    CHECK(byte_count(some) == 4);
    CHECK(as_text(joined(some)) == "abcd");
    CHECK(byte_count({}) == 0);
    CHECK(joined({}).empty());
    CHECK(joined(std::span(some).last(1)).data() == some.back().data());
}

TEST_CASE("a blob may be a copy, of a part of another, which need not stay") {
    Blob whole(to_bytes("abcdef"));
    const Blob copy = Blob::copy(whole.part(2, 3));
    CHECK(copy.data() != whole.data() + 2);
    whole = Blob();
    CHECK(as_text(copy) == "cde");
    CHECK(Blob::copy({}).empty());
}

TEST_CASE("a part of a blob is the same bytes in memory, and keeps them") {
    Blob whole(to_bytes("abcdef"));
    const std::byte* const begin = whole.data();
    const Blob part = whole.part(2, 3);
    whole = Blob();
    CHECK(part.data() == begin + 2);
    CHECK(as_text(part) == "cde");
    CHECK(as_text(part.part(1, 2)) == "de");
    CHECK(part.part(3, 0).empty());
}

TEST_CASE("a blob is cut into parts of one size and a rest, not copied") {
    const Blob whole(to_bytes("abcdefg"));
    const auto texts = [](const std::vector<Blob>& parts) {
        std::vector<std::string_view> all;
        for (const Blob& part : parts)
            all.push_back(as_text(part));
        return all;
    };
    CHECK(texts(cut(whole, 3)) == std::vector<std::string_view>{"abc", "def", "g"});
    CHECK(texts(cut(whole.part(0, 6), 3)) == std::vector<std::string_view>{"abc", "def"});
    CHECK(texts(cut(whole, 7)) == std::vector<std::string_view>{"abcdefg"});
    CHECK(texts(cut(whole, 100)) == std::vector<std::string_view>{"abcdefg"});
    CHECK(texts(cut(Blob(), 3)) == std::vector<std::string_view>{""});
    CHECK(cut(whole, 3)[1].data() == whole.data() + 3);
}
