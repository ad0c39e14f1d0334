// What two programs have said to each other on one connection: README.md says how it was kept.
#pragma once

#include "common/base/bytes.hpp"
#include "common/protocol/codec.hpp"
#include "common/protocol/packing.hpp"

#include <algorithm>
#include <doctest/doctest.h>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

namespace fraja {

struct Captured {
    bool from_caller = false; ///< it was said by whoever had connected
    std::vector<Blob> frames; ///< of ZeroMQ's
    /// Of a message on a session.
    [[nodiscard]] std::vector<Blob> unpacked() const { return protocol::unpack(frames.at(0)); }
    /// Of one on the stream: what is behind the topic.
    [[nodiscard]] std::vector<Blob> published() const { return {frames.begin() + 1, frames.end()}; }
};
using Capture = std::vector<Captured>;

inline const std::filesystem::path captures = FRAJA_SOURCE_DIR "/tests/captures";
/// The folder there of the version before this one.
inline const std::string last_version = std::to_string(protocol::oldest_version_spoken);

inline Capture read_capture(const std::filesystem::path& file) {
    std::ifstream in(file);
    REQUIRE_MESSAGE(in.good(), file);
    const auto digit = [](char c) { return c <= '9' ? c - '0' : c - 'a' + 10; };
    Capture capture;
    for (std::string line; std::getline(in, line);) {
        std::istringstream words(line);
        std::string word;
        words >> word;
        Captured& message = capture.emplace_back();
        message.from_caller = word == ">";
        while (words >> word) {
            Bytes bytes;
            for (std::size_t i = 0; word != "-" && i + 1 < word.size(); i += 2)
                bytes.push_back(static_cast<std::byte>(digit(word[i]) * 16 + digit(word[i + 1])));
            message.frames.emplace_back(std::move(bytes));
        }
    }
    REQUIRE_FALSE(capture.empty());
    return capture;
}

inline std::vector<Blob> frames_of(const protocol::Packet& packet) {
    std::vector<Blob> frames{Blob(packet.header), Blob(packet.body)};
    frames.insert(frames.end(), packet.blobs.begin(), packet.blobs.end());
    return frames;
}

/// Of a session's, at one end: its words are said in their turn, when all that had come before them
/// has come again. But for beats, which are a matter of time.
class Part {
public:
    enum class Of { caller, called };
    Part(const Capture& capture, Of of) : capture_(&capture), of_caller_(of == Of::caller) {}

    void hear(const protocol::Message& message) { ++heard_[protocol::name_of(message)]; }
    /// What is to be said next, if it is its turn.
    [[nodiscard]] const Captured* next() const {
        std::map<std::string_view, int> before;
        for (std::size_t i = 0; i < capture_->size(); ++i) {
            const Captured& said = (*capture_)[i];
            if (said.from_caller == of_caller_) {
                if (i >= at_)
                    return &said;
                continue;
            }
            const auto frames = said.unpacked();
            // Hellos of a later version are known by their number alone.
            const auto message = protocol::decode(frames);
            const auto name = message ? protocol::name_of(*message) : "";
            if (name != "" && name != "Beat" && name != "WorkerBeat" &&
                count(name) < ++before[name])
                return nullptr;
        }
        return nullptr;
    }
    void said(const Captured* said) { at_ = static_cast<std::size_t>(said - capture_->data()) + 1; }
    [[nodiscard]] bool is_over() const {
        return std::none_of(capture_->begin() + static_cast<std::ptrdiff_t>(at_), capture_->end(),
                            [&](const Captured& c) { return c.from_caller == of_caller_; });
    }
    [[nodiscard]] int count(std::string_view name) const {
        const auto found = heard_.find(name);
        return found == heard_.end() ? 0 : found->second;
    }

private:
    const Capture* capture_;
    bool of_caller_;
    std::size_t at_ = 0;
    std::map<std::string_view, int> heard_;
};

/// Messages of one kind in a capture, in their order.
template <class M>
std::vector<M> all_of(const Capture& capture) {
    std::vector<M> result;
    for (const Captured& said : capture) {
        const auto message = protocol::decode(said.unpacked());
        if (message && std::holds_alternative<M>(*message))
            result.push_back(std::get<M>(*message));
    }
    return result;
}

[[nodiscard]] inline bool is_of_stream(const std::filesystem::path& file) {
    return file.stem().string().ends_with("_stream");
}

/// All that there are of a version, in the order of their names.
inline std::vector<std::filesystem::path> capture_files(const std::string& folder) {
    std::vector<std::filesystem::path> files;
    for (const auto& entry : std::filesystem::directory_iterator(captures / folder))
        if (entry.path().extension() == ".txt")
            files.push_back(entry.path());
    std::ranges::sort(files);
    REQUIRE_FALSE(files.empty());
    return files;
}

} // namespace fraja
