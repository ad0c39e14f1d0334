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
