// A fuzzer without libFuzzer: runs every file of a corpus, then mutations of them, the same every
// time. An input that crashes is left in the working folder, as decode_replay-crash.
//
//   decode_replay tests/fuzz/corpus/decode          and 10000 mutations
//   decode_replay tests/fuzz/corpus/decode 100000
//   decode_replay decode_replay-crash               one file alone
#include "common/base/rng.hpp"

#include <algorithm>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);
// Where a sanitizer is linked: it ends the program without a signal.
extern "C" [[gnu::weak]] void __sanitizer_set_death_callback(void (*callback)());

namespace {

namespace fs = std::filesystem;
using Bytes = std::vector<std::uint8_t>;

constexpr std::uint64_t mutations_default = 10'000;
constexpr std::size_t input_bytes_max = 4'096;

const Bytes* running = nullptr;
std::string crash_file;

void keep_input() {
    if (!running)
        return;
    if (std::FILE* file = std::fopen(crash_file.c_str(), "wb")) {
        std::fwrite(running->data(), 1, running->size(), file);
        std::fclose(file);
        std::fprintf(stderr, "the input that crashed is in ./%s\n", crash_file.c_str());
    }
    running = nullptr;
}

extern "C" void on_abort(int) {
    keep_input();
}

Bytes read_file(const fs::path& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
}

/// In the order of their names, so that it is the same everywhere.
std::vector<Bytes> read_corpus(const fs::path& path) {
    std::vector<fs::path> files;
    if (fs::is_directory(path))
        for (const auto& entry : fs::directory_iterator(path))
            files.push_back(entry.path());
    else
        files.push_back(path);
    std::ranges::sort(files);
    std::vector<Bytes> corpus;
    for (const fs::path& file : files)
        corpus.push_back(read_file(file));
    return corpus;
}

void mutate(fraja::Rng& rng, Bytes& input, const std::vector<Bytes>& corpus) {
    const auto place = [&] {
        return input.begin() + static_cast<std::ptrdiff_t>(rng.below(input.size() + 1));
    };
    const auto byte = [&] { return static_cast<std::uint8_t>(rng.next()); };
    switch (rng.below(input.empty() ? 2 : 6)) {
    case 0:
        input.insert(place(), byte());
        break;
    case 1: { // a piece of another one
        const Bytes& other = corpus[rng.below(corpus.size())];
        const std::size_t from = rng.below(other.size() + 1);
        const std::size_t length = std::min<std::size_t>(other.size() - from, 1 + rng.below(64));
        const auto begin = other.begin() + static_cast<std::ptrdiff_t>(from);
        input.insert(place(), begin, begin + static_cast<std::ptrdiff_t>(length));
        break;
    }
    case 2:
        input[rng.below(input.size())] = byte();
        break;
    case 3:
        input[rng.below(input.size())] ^= static_cast<std::uint8_t>(1u << rng.below(8));
        break;
    case 4: { // a gap
        const auto begin = place();
        const auto rest = static_cast<std::uint64_t>(input.end() - begin);
        input.erase(begin, begin + static_cast<std::ptrdiff_t>(
                                       std::min<std::uint64_t>(rest, 1 + rng.below(16))));
        break;
    }
    case 5:
        input.resize(rng.below(input.size() + 1));
        break;
    }
    input.resize(std::min(input.size(), input_bytes_max));
}

void run(const Bytes& input) {
    running = &input;
    LLVMFuzzerTestOneInput(input.data(), input.size());
    running = nullptr;
}

} // namespace

int main(int argc, char** argv) {
    if (argc != 2 && argc != 3) {
        std::fprintf(stderr, "usage: %s CORPUS [MUTATIONS]\n", argv[0]);
        return 2;
    }
    crash_file = fs::path(argv[0]).filename().string() + "-crash";
    std::signal(SIGABRT, on_abort);
    if (__sanitizer_set_death_callback)
        __sanitizer_set_death_callback(keep_input);
    const std::vector<Bytes> corpus = read_corpus(argv[1]);
    if (corpus.empty()) {
        std::fprintf(stderr, "%s: there is no input in %s\n", argv[0], argv[1]);
        return 1;
    }
    for (const Bytes& input : corpus)
        run(input);
    const bool alone = !fs::is_directory(argv[1]);
    const std::uint64_t mutations = argc == 3 ? std::strtoull(argv[2], nullptr, 10)
                                    : alone   ? 0
                                              : mutations_default;
    for (std::uint64_t seed = 1; seed <= mutations; ++seed) {
        fraja::Rng rng(seed);
        Bytes input = corpus[rng.below(corpus.size())];
        for (std::uint64_t n = 1 + rng.below(8); n > 0; --n)
            mutate(rng, input, corpus);
        run(input);
    }
    std::printf("%zu inputs and %llu mutations of them\n", corpus.size(),
                static_cast<unsigned long long>(mutations));
    return 0;
}
