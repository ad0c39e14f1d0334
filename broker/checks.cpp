#include "broker/checks.hpp"

#include "common/base/assert.hpp"

#include <algorithm>
#include <utility>

namespace fraja::broker {

namespace {

// Where nobody else can tell who is right, each of those who disagree is asked so often in all.
constexpr std::ptrdiff_t answers_of_one_max = 2;

using Check = Checks::Check;
using Answer = Checks::Answer;

std::ptrdiff_t answers_of(const Check& check, const std::string& voter) {
    return std::ranges::count(check.answers, voter, &Answer::voter);
}

bool contradicts_itself(const Check& check, const WorkerId& worker) {
    const auto first = std::ranges::find(check.answers, worker, &Answer::worker);
    return std::ranges::any_of(check.answers, [&](const Answer& other) {
        return other.worker == worker && other.pixels != first->pixels;
    });
}

std::set<std::string> who_says(const Check& check, const ContentHash& pixels) {
    std::set<std::string> voters;
    for (const Answer& answer : check.answers)
        if (answer.pixels == pixels && !contradicts_itself(check, answer.worker))
            voters.insert(answer.voter);
    return voters;
}

/// Who contradicts itself, and who is alone against two who agree.
std::vector<WorkerId> wrong_ones(const Check& check) {
    const Answer* agreed = nullptr;
    for (const Answer& answer : check.answers)
        if (who_says(check, answer.pixels).size() > 1)
            agreed = &answer;
    std::vector<WorkerId> wrong;
    for (const Answer& answer : check.answers)
        if (std::ranges::find(wrong, answer.worker) == wrong.end() &&
            (contradicts_itself(check, answer.worker) ||
             (agreed && answer.pixels != agreed->pixels)))
            wrong.push_back(answer.worker);
    return wrong;
}

} // namespace

bool Checks::Check::agrees() const {
    return std::ranges::all_of(
        answers, [this](const Answer& answer) { return answer.pixels == answers.front().pixels; });
}

bool Checks::Check::is_new_to(const WorkerId& worker, const std::string& voter) const {
    return answers_of(*this, voter) == 0 && std::ranges::find(failed_on, worker) == failed_on.end();
}

std::set<CheckId>& Checks::queue_of(const Check& check) {
    return check.agrees() ? pending_[check.answers.front().voter] : contested_;
}

void Checks::enter(CheckId id) {
    queue_of(open_.at(id)).insert(id);
}

void Checks::leave(CheckId id) {
    const Check& check = open_.at(id);
    FRAJA_ASSERT(queue_of(check).erase(id) == 1);
    if (const auto queue = pending_.find(check.answers.front().voter);
        queue != pending_.end() && queue->second.empty())
        pending_.erase(queue);
}

void Checks::add(const Tile& tile, Answer first) {
    const auto id = CheckId(++count_);
    open_.emplace(id, Check{.tile = tile, .answers = {std::move(first)}});
    enter(id);
}

const Checks::Check* Checks::find(CheckId id) const {
    const auto found = open_.find(id);
    return found == open_.end() ? nullptr : &found->second;
}

const Checks::Check* Checks::contested() const {
    const auto found =
        std::ranges::find_if(open_, [](const auto& entry) { return !entry.second.agrees(); });
    return found == open_.end() ? nullptr : &found->second;
}

bool Checks::may_answer(const Check& check, const WorkerId& worker, const std::string& voter,
                        const HasOthers& has_others) {
    if (check.is_new_to(worker, voter))
        return true;
    return !check.agrees() && answers_of(check, voter) < answers_of_one_max &&
           std::ranges::find(check.failed_on, worker) == check.failed_on.end() &&
           !has_others(check);
}

std::optional<CheckId> Checks::next_for(const WorkerId& worker, const std::string& voter,
                                        const HasOthers& has_others) const {
    const auto fits = [&](CheckId id) {
        return may_answer(open_.at(id), worker, voter, has_others);
    };
    if (const auto at = std::ranges::find_if(contested_, fits); at != contested_.end())
        return *at;
    for (const auto& [first, checks] : pending_)
        if (first != voter)
            if (const auto at = std::ranges::find_if(checks, fits); at != checks.end())
                return *at;
    return std::nullopt;
}

void Checks::assign(CheckId id, Assignment assignment) {
    leave(id);
    open_.at(id).assignment = std::move(assignment);
}

void Checks::take_back(CheckId id, const std::optional<WorkerId>& failed_on) {
    Check& check = open_.at(id);
    FRAJA_ASSERT(check.assignment.has_value());
    check.assignment.reset();
    if (failed_on)
        check.failed_on.push_back(*failed_on);
    enter(id);
}

void Checks::forgive_failures() {
    for (const CheckId id : contested_)
        open_.at(id).failed_on.clear();
}

std::vector<WorkerId> Checks::answer(CheckId id, Answer answer) {
    Check& check = open_.at(id);
    FRAJA_ASSERT(check.assignment.has_value());
    check.assignment.reset();
    check.answers.push_back(std::move(answer));
    std::vector<WorkerId> wrong = wrong_ones(check);
    enter(id);
    if (wrong.empty())
        close_if_agreed(id);
    return wrong;
}

void Checks::close_if_agreed(CheckId id) {
    const Check& check = open_.at(id);
    if (!check.agrees() || who_says(check, check.answers.front().pixels).size() < 2)
        return;
    ++counts_.agreed;
    leave(id);
    open_.erase(id);
}

std::vector<Checks::Unwanted> Checks::forget(const WorkerId& worker) {
    std::vector<CheckId> its_own, others;
    for (const auto& [id, check] : open_)
        if (check.answers.front().worker == worker)
            its_own.push_back(id);
        else if (std::ranges::find(check.answers, worker, &Answer::worker) != check.answers.end())
            others.push_back(id);
    std::vector<Unwanted> unwanted;
    for (const CheckId id : its_own) {
        const Check& check = open_.at(id);
        if (check.assignment)
            unwanted.push_back({check.tile, *check.assignment});
        else
            leave(id);
        open_.erase(id);
    }
    for (const CheckId id : others) {
        Check& check = open_.at(id);
        const bool is_pending = !check.assignment;
        if (is_pending)
            leave(id);
        std::erase_if(check.answers, [&](const Answer& a) { return a.worker == worker; });
        if (is_pending) {
            enter(id);
            close_if_agreed(id);
        }
    }
    return unwanted;
}

std::uint32_t Checks::give_up(const HasOthers& has_others) {
    const bool somebody_is_at_one = std::ranges::any_of(
        open_, [](const auto& entry) { return entry.second.assignment.has_value(); });
    if (somebody_is_at_one || !contested_.empty())
        return 0;
    for (const auto& [first, checks] : pending_) {
        std::optional<bool> has_second; // of those that nobody has failed at: the same for all
        for (const CheckId id : checks) {
            const Check& check = open_.at(id);
            const bool is_plain = check.answers.size() == 1 && check.failed_on.empty();
            if (is_plain && !has_second)
                has_second = has_others(check);
            if (is_plain ? *has_second : has_others(check))
                return 0;
        }
    }
    const auto count = static_cast<std::uint32_t>(open_.size());
    clear();
    counts_.unchecked += count;
    return count;
}

std::vector<Tile> Checks::tiles() const {
    std::vector<Tile> tiles;
    for (const auto& [id, check] : open_)
        tiles.push_back(check.tile);
    return tiles;
}

std::vector<Checks::Unwanted> Checks::take_all_back() {
    std::vector<Unwanted> unwanted;
    for (auto& [id, check] : open_)
        if (check.assignment) {
            unwanted.push_back({check.tile, *check.assignment});
            check.assignment.reset();
            enter(id);
        }
    return unwanted;
}

void Checks::clear() {
    open_.clear();
    pending_.clear();
    contested_.clear();
}

} // namespace fraja::broker
