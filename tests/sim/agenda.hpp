// Agenda: pretend time, and what is to be done when.
#pragma once

#include "common/base/instant.hpp"

#include <algorithm>
#include <cstdint>
#include <memory>
#include <tuple>
#include <utility>
#include <vector>

namespace fraja::sim {

/// Something to be done once. Unlike std::function it may hold what can only be moved, so messages
/// travel without being copied.
class Deed {
public:
    template <class F>
    explicit Deed(F deed) : body_(std::make_unique<Body<F>>(std::move(deed))) {}
    void operator()() { body_->run(); }

private:
    struct Base {
        Base() = default;
        Base(const Base&) = delete;
        Base& operator=(const Base&) = delete;
        virtual ~Base() = default;
        virtual void run() = 0;
    };
    template <class F>
    struct Body final : Base {
        explicit Body(F d) : deed(std::move(d)) {}
        void run() override { deed(); }
        F deed;
    };
    std::unique_ptr<Base> body_;
};

class Agenda {
public:
    [[nodiscard]] Instant now() const { return now_; }
    [[nodiscard]] bool empty() const { return entries_.empty(); }
    /// When the next deed is due. There must be one.
    [[nodiscard]] Instant next() const { return entries_.front().at; }

    /// At the same instant what was planned first is done first. The past is now.
    template <class F>
    void at(Instant when, F deed) {
        entries_.push_back({std::max(when, now_), ++order_, Deed(std::move(deed))});
        std::push_heap(entries_.begin(), entries_.end(), later);
    }
    template <class F>
    void after(Duration pause, F deed) {
        at(now_ + pause, std::move(deed));
    }
    void run_next() {
        std::pop_heap(entries_.begin(), entries_.end(), later);
        now_ = entries_.back().at;
        Deed deed = std::move(entries_.back().deed);
        entries_.pop_back();
        deed();
    }

private:
    struct Entry {
        Instant at;
        std::uint64_t order;
        Deed deed;
    };
    static bool later(const Entry& a, const Entry& b) {
        return std::tie(a.at, a.order) > std::tie(b.at, b.order);
    }

    Instant now_{};
    std::uint64_t order_ = 0;
    std::vector<Entry> entries_; // a heap, the soonest first
};

} // namespace fraja::sim
