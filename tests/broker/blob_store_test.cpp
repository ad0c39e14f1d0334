#include "broker/blob_store.hpp"

#include "common/protocol/content_hash.hpp"
#include "common/protocol/limits.hpp"

#include <algorithm>
#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::broker;
using protocol::chunk_bytes;
using protocol::content_hash;

namespace {

Bytes some_bytes(std::size_t size) {
    Bytes bytes(size);
    for (std::size_t i = 0; i < size; ++i)
        bytes[i] = static_cast<std::byte>(i * 31 + i / 1000);
    return bytes;
}

protocol::Chunk chunk_of(const Bytes& bytes, std::uint64_t offset) {
    protocol::Chunk chunk{content_hash(bytes), offset, bytes.size(), {}};
    const auto size = std::min<std::uint64_t>(chunk_bytes, bytes.size() - offset);
    const auto begin = bytes.begin() + static_cast<std::ptrdiff_t>(offset);
    chunk.blobs.push_back(Blob(Bytes(begin, begin + static_cast<std::ptrdiff_t>(size))));
    return chunk;
}

} // namespace

TEST_CASE("a blob arrives chunk by chunk and is given out as it came") {
    const Bytes bytes = some_bytes(2 * chunk_bytes + 17);
    const ContentHash hash = content_hash(bytes);
    BlobStore store(1 << 30);
    REQUIRE(store.acquire(hash, bytes.size()).has_value());
    CHECK(store.add(chunk_of(bytes, 0)) == BlobStore::Arrival::more);
    CHECK(store.add(chunk_of(bytes, 0)) == BlobStore::Arrival::ignored); // the same again
    CHECK(store.wanted_offset(hash) == chunk_bytes);
    CHECK_FALSE(store.chunk(hash, 0).has_value()); // not before it is whole
    CHECK(store.add(chunk_of(bytes, chunk_bytes)) == BlobStore::Arrival::more);
    CHECK(store.add(chunk_of(bytes, 2 * chunk_bytes)) == BlobStore::Arrival::complete);
    CHECK(store.complete(hash));
    for (const std::uint64_t offset : {std::uint64_t{0}, chunk_bytes, 2 * chunk_bytes}) {
        const auto chunk = store.chunk(hash, offset);
        REQUIRE(chunk.has_value());
        CHECK(chunk->blobs.front() == chunk_of(bytes, offset).blobs.front());
        CHECK(store.chunk(hash, offset)->blobs.front().data() ==
              chunk->blobs.front().data()); // many may ask for it
    }
    CHECK(joined(store.chunks(hash)) == Blob(bytes));
    CHECK_FALSE(store.chunk(hash, 1).has_value());
    CHECK_FALSE(store.chunk(hash, 3 * chunk_bytes).has_value());
}

TEST_CASE("a blob that comes whole is given out chunk by chunk, not copied") {
    const Bytes bytes = some_bytes(2 * chunk_bytes + 17);
    const ContentHash hash = content_hash(bytes);
    BlobStore store(1 << 30);
    REQUIRE(store.acquire(hash, bytes.size()).has_value());
    CHECK(store.add(chunk_of(bytes, 0)) == BlobStore::Arrival::more); // what had come goes
    const Blob whole(bytes);
    store.restore(hash, whole);
    for (const std::uint64_t offset : {std::uint64_t{0}, chunk_bytes, 2 * chunk_bytes}) {
        const Blob chunk = store.chunk(hash, offset).value().blobs.front();
        CHECK(chunk == chunk_of(bytes, offset).blobs.front());
        CHECK(chunk.begin() == whole.begin() + offset);
    }
    CHECK(store.add(chunk_of(bytes, chunk_bytes)) == BlobStore::Arrival::ignored);
}

TEST_CASE("bytes with another hash than announced are not kept") {
    const Bytes bytes = some_bytes(100);
    Bytes other = bytes;
    other[50] = std::byte{0};
    BlobStore store(1000);
    REQUIRE(store.acquire(content_hash(bytes), bytes.size()).has_value());
    auto chunk = chunk_of(other, 0);
    chunk.blob = content_hash(bytes);
    CHECK(store.add(chunk) == BlobStore::Arrival::wrong_hash);
    CHECK(store.wanted_offset(chunk.blob) == 0);
    CHECK(store.add(chunk_of(bytes, 0)) == BlobStore::Arrival::complete);
}

TEST_CASE("chunks that nobody asked for are ignored") {
    const Bytes bytes = some_bytes(100);
    BlobStore store(1000);
    CHECK(store.add(chunk_of(bytes, 0)) == BlobStore::Arrival::ignored);
    REQUIRE(store.acquire(content_hash(bytes), bytes.size()).has_value());
    auto wrong_total = chunk_of(bytes, 0);
    wrong_total.total_bytes = 99;
    CHECK(store.add(wrong_total) == BlobStore::Arrival::ignored);
    auto short_one = chunk_of(bytes, 0);
    short_one.blobs = {Blob(some_bytes(10))};
    CHECK(store.add(short_one) == BlobStore::Arrival::ignored);
}

TEST_CASE("a blob goes with the last job that needs it and its size is bounded") {
    const Bytes bytes = some_bytes(600);
    const ContentHash hash = content_hash(bytes);
    BlobStore store(1000);
    REQUIRE(store.acquire(hash, 600).has_value());
    REQUIRE(store.acquire(hash, 600).has_value());
    CHECK(store.bytes() == 600);
    CHECK(store.acquire(ContentHash{}, 401).error().code == ErrorCode::limit_exceeded);
    CHECK(store.acquire(hash, 601).error().code == ErrorCode::invalid_argument);
    store.release(hash);
    CHECK(store.bytes() == 600);
    store.release(hash);
    CHECK(store.bytes() == 0);
    CHECK(store.acquire(ContentHash{}, 401).has_value());
}
