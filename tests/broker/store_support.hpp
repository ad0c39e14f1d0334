// What the store's tests share: a directory that goes away, and things to keep.
#pragma once

#include "broker/store.hpp"
#include "broker/store_reader.hpp"
#include "broker/store_schema.hpp"
#include "common/base/rng.hpp"
#include "common/protocol/content_hash.hpp"
#include "common/protocol/limits.hpp"
#include "tests/support/file_bytes.hpp"
#include "tests/support/messages.hpp"

#include <algorithm>
#include <doctest/doctest.h>
#include <filesystem>
#include <initializer_list>
#include <string>
#include <vector>

namespace fraja::broker {

class TempDirectory {
public:
    TempDirectory() {
        path_ = std::filesystem::temp_directory_path() /
                ("fraja-store-" + to_string(random_id<Nonce>()));
        std::filesystem::create_directory(path_);
    }
    ~TempDirectory() {
        std::error_code ec;
        std::filesystem::permissions(path_, std::filesystem::perms::owner_all, ec);
        std::filesystem::remove_all(path_, ec);
    }
    TempDirectory(const TempDirectory&) = delete;
    TempDirectory& operator=(const TempDirectory&) = delete;
    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    [[nodiscard]] std::filesystem::path file() const { return path_ / store_file_name; }

private:
    std::filesystem::path path_;
};

inline Store open_store(const std::filesystem::path& directory, StoreOptions options = {}) {
    auto store = Store::open(directory, std::move(options));
    if (!store)
        FAIL(store.error().message);
    return std::move(*store);
}

inline Contents contents_of(const Store& store) {
    auto reader = StoreReader::open(store);
    REQUIRE(reader.has_value());
    auto contents = reader->read();
    if (!contents)
        FAIL(contents.error().message);
    return std::move(*contents);
}

inline void commit(Store& store, std::initializer_list<Write> writes,
                   Durability durability = Durability::written) {
    const std::vector<Write> all(writes);
    const auto done = store.commit(all, durability);
    if (!done)
        FAIL(done.error().message);
}

inline Bytes noise(Rng& rng, std::size_t size) {
    Bytes bytes(size);
    for (auto& byte : bytes)
        byte = static_cast<std::byte>(rng.next());
    return bytes;
}

inline PutBlob scene_of(const Bytes& bytes) {
    return {protocol::content_hash(bytes), {Blob(bytes)}};
}

inline PutJob job_of(Rng& rng, std::uint32_t number, const ContentHash& scene = {}) {
    PutJob job{random_message_of<protocol::SubmitJob>(rng), number, 1};
    job.submission.scene = scene;
    return job;
}

/// A tile with so many bytes of pixels, cut as they travel.
inline PutTile tile_of(Rng& rng, const JobId& job, std::uint32_t index, std::size_t size) {
    auto tile = random_message_of<protocol::TileDone>(rng);
    tile.job = job;
    tile.tile = TileIndex{index};
    tile.rect = {0, 0, 8, 8};
    tile.blobs.clear();
    do {
        const std::size_t piece = std::min(size, protocol::chunk_bytes);
        tile.blobs.push_back(Blob(noise(rng, piece)));
        size -= piece;
    } while (size > 0);
    return {std::make_shared<const protocol::TileDone>(std::move(tile))};
}

inline bool same_tile(const protocol::TileDone& a, const protocol::TileDone& b) {
    return a.job == b.job && a.tile == b.tile && a.frame == b.frame && a.pass == b.pass &&
           a.rect == b.rect && a.worker_name == b.worker_name && a.rays == b.rays &&
           a.elapsed == b.elapsed && a.blobs == b.blobs;
}

} // namespace fraja::broker
