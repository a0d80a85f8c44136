#include "anigen/train/distributed/watchdog.h"

#include <algorithm>
#include <condition_variable>
#include <mutex>
#include <sstream>

namespace anigen::train {

namespace {

using Clock = Watchdog::Clock;
using Seconds = Watchdog::Seconds;

constexpr double kMissedBeats = 3.5;      // after which a rank whose connection broke counts as dead
constexpr double kStepsOfPatience = 5.0;  // a wait as long as so many of the longest steps is a hang
constexpr double kFirstPatience = 10.0;   // timeouts, before the first step: datasets are opened, files are read
constexpr Seconds kExplaining{10.0};      // to find out why a connection broke
constexpr Seconds kLooking{0.1};
constexpr Seconds kLeaving{5.0};  // to tell the others, and for them to read it
constexpr char kComputes = 'c', kWaits = 'w', kIsBusy = 'b';

std::string rounded(Seconds duration) { return std::to_string(static_cast<long long>(duration.count() + 0.5)) + " s"; }

// "rank 2", "ranks 2 and 3", "ranks 2, 3 and 5"
std::string named(const std::vector<int>& ranks) {
  std::string text = ranks.size() == 1 ? "rank " : "ranks ";
  for (std::size_t i = 0; i < ranks.size(); ++i) {
    if (i > 0) text += i + 1 == ranks.size() ? " and " : ", ";
    text += std::to_string(ranks[i]);
  }
  return text;
}

std::string beat_key(int rank) { return "beat/" + std::to_string(rank); }

}  // namespace

/// State of another rank.
struct Watchdog::Peer {
  std::string sign;           // as read last: "<beat> <step> <what it does>"
  Clock::time_point changed;  // when it last became another one, by our clock
  std::int64_t step = 0;
  char doing = kComputes;

  void read(const std::string& found, Clock::time_point now) {
    if (found == sign) return;
    sign = found;
    changed = now;
    std::istringstream words(sign);
    std::int64_t beat = 0;
    words >> beat >> step >> doing;
  }
};

struct Watchdog::State {
  std::shared_ptr<SharedKeys> keys;
  Options options;

  std::mutex mutex;
  std::condition_variable poke, left;
  bool stop = false, watching = false, waiting = false, gone = false;
  bool lost = false;       // a rank cannot leave any more
  std::int64_t step = -1;  // before the first report
  Activity activity = Activity::kTraining;
  Clock::time_point step_began = Clock::now();
  Seconds longest_step{0.0};
  std::string leaving;                        // reason to tell; empty: stays
  std::vector<Peer> peers;                    // [size]
  std::string failure, keys_error;            // what somebody told; what the keys say when they are out of reach
  Clock::time_point answered = Clock::now();  // when the keys last did

  // Up to when we looked last: that this process was held up must not count as silence of the others.
  std::vector<int> silent_for(Seconds limit) const {
    std::vector<int> found;
    for (int rank = 0; rank < options.size; ++rank) {
      if (rank != options.rank && answered - peers[static_cast<std::size_t>(rank)].changed > limit)
        found.push_back(rank);
    }
    return found;
  }
  std::vector<int> that(char doing) const {
    std::vector<int> found;
    for (int rank = 0; rank < options.size; ++rank) {
      if (rank != options.rank && peers[static_cast<std::size_t>(rank)].doing == doing) found.push_back(rank);
    }
    return found;
  }
  std::string last_step_of(int rank) const { return std::to_string(peers[static_cast<std::size_t>(rank)].step); }
  Seconds patience() const {
    if (longest_step.count() == 0.0) return kFirstPatience * options.timeout;
    return std::max(options.timeout, kStepsOfPatience * longest_step);
  }
  // From now on the signs of others are read; what was seen of them before is too old to judge by.
  void watch() {
    if (watching) return;
    watching = true;
    for (Peer& peer : peers) peer.changed = Clock::now();
    answered = Clock::now();
    poke.notify_all();
  }
};

Watchdog::Watchdog(std::shared_ptr<SharedKeys> keys, const Options& options) : state_(std::make_shared<State>()) {
  state_->keys = std::move(keys);
  state_->options = options;
  state_->peers.resize(static_cast<std::size_t>(options.size));
  thread_ = std::thread([state = state_] { beat(state); });
}

Watchdog::~Watchdog() {
  std::unique_lock<std::mutex> lock(state_->mutex);
  state_->stop = true;
  state_->poke.notify_all();
  const bool gone = state_->left.wait_for(lock, kLeaving, [this] { return state_->gone; });
  lock.unlock();
  if (gone) {
    thread_.join();
  } else {
    thread_.detach();  // in a call to a host that does not answer; it holds all it needs
  }
}

void Watchdog::beat(const std::shared_ptr<State>& state) {
  const int rank = state->options.rank, size = state->options.size;
  std::unique_lock<std::mutex> lock(state->mutex);
  for (std::int64_t beats = 1; !state->stop && state->leaving.empty(); ++beats) {
    const char doing = state->activity == Activity::kBusy ? kIsBusy : (state->waiting ? kWaits : kComputes);
    const std::string sign = std::to_string(beats) + " " + std::to_string(state->step) + " " + doing;
    const bool watching = state->watching;
    lock.unlock();
    std::vector<std::optional<std::string>> signs(static_cast<std::size_t>(size));
    std::optional<std::string> failure;
    std::string error;
    try {
      state->keys->set(beat_key(rank), sign);
      if (watching) failure = state->keys->find("failure");
      for (int other = 0; watching && other < size; ++other) {
        if (other != rank) signs[static_cast<std::size_t>(other)] = state->keys->find(beat_key(other));
      }
    } catch (const std::exception& problem) {
      error = problem.what();
      error.erase(std::min(error.find('\n'), error.size()));
    }
    lock.lock();
    const Clock::time_point now = Clock::now();
    if (error.empty()) {
      state->answered = now;
      if (failure) state->failure = *failure;
      for (std::size_t other = 0; other < signs.size(); ++other) {
        if (signs[other]) state->peers[other].read(*signs[other], now);
      }
    }
    state->keys_error = error;
    state->poke.wait_for(lock, state->options.beat,
                         [&] { return state->stop || !state->leaving.empty() || (state->watching && !watching); });
  }
  if (!state->leaving.empty()) {
    const std::string reason = state->leaving;
    lock.unlock();
    try {
      if (state->keys->add("failures", 1) == 1) state->keys->set("failure", reason);
      state->keys->add("left", 1);
      // The others have read the reason when they leave, too; a lost one never will.
      const int expected = state->lost ? size - 1 : size;
      const Clock::time_point until = Clock::now() + std::chrono::duration_cast<Clock::duration>(kLeaving);
      while (state->options.keeps && state->keys->add("left", 0) < expected && Clock::now() < until)
        std::this_thread::sleep_for(std::chrono::milliseconds(50));
    } catch (const std::exception& problem) {
      std::fprintf(stderr, "the other ranks could not be told: %s\n", problem.what());
    }
    lock.lock();
  }
  state->gone = true;
  state->left.notify_all();
}

void Watchdog::report(std::int64_t step, Activity activity) {
  const std::lock_guard<std::mutex> lock(state_->mutex);
  const Clock::time_point now = Clock::now();
  if (step != state_->step && state_->step >= 0)
    state_->longest_step = std::max(state_->longest_step, Seconds(now - state_->step_began));
  // Time spent on checkpoints and evaluations does not count as part of a step: that begins when they end.
  if (step != state_->step || activity != state_->activity) state_->step_began = now;
  state_->step = step;
  state_->activity = activity;
}

void Watchdog::lose(const std::string& reason) {
  {
    const std::lock_guard<std::mutex> lock(state_->mutex);
    state_->lost = state_->failure.empty();  // found out here, not told by one that has left
  }
  leave(reason);
  throw RankLost(reason);
}

void Watchdog::check(Clock::time_point since) {
  std::unique_lock<std::mutex> lock(state_->mutex);
  state_->waiting = true;
  state_->watch();
  const Clock::time_point now = Clock::now();
  const Seconds timeout = state_->options.timeout;
  std::string reason;
  if (!state_->failure.empty()) {
    reason = state_->failure;
  } else if (!state_->options.keeper.empty() && !state_->keys_error.empty()) {
    reason = state_->options.keeper + ", which keeps the rendezvous, is gone (" + state_->keys_error + ")";
  } else if (now - state_->answered > timeout) {
    reason = (state_->options.keeper.empty() ? "the rendezvous file" : state_->options.keeper) +
             " has not answered for " + rounded(now - state_->answered);
  } else if (const std::vector<int> silent = state_->silent_for(timeout); !silent.empty()) {
    reason = named(silent) + " gave no sign of life for " + rounded(timeout) + ", last seen in step " +
             state_->last_step_of(silent.front());
  } else if (now - since > state_->patience() + kMissedBeats * state_->options.beat && state_->that(kIsBusy).empty()) {
    // The margin: a rank that is silent should be called that.
    const std::vector<int> computing = state_->that(kComputes);
    reason = computing.empty() ? "all ranks are alive and wait for each other: a connection between them is gone"
                               : named(computing) + " hangs: still in step " + state_->last_step_of(computing.front()) +
                                     " while the others have waited for " + rounded(now - since);
  }
  lock.unlock();
  if (!reason.empty()) lose(reason);
}

void Watchdog::done_waiting() {
  const std::lock_guard<std::mutex> lock(state_->mutex);
  state_->waiting = state_->watching = false;
}

void Watchdog::explain(const std::string& error) {
  const Clock::time_point begin = Clock::now();
  const Seconds patience =
      std::max(Seconds(kMissedBeats * state_->options.beat) * 1.5, std::min(kExplaining, state_->options.timeout));
  {
    const std::lock_guard<std::mutex> lock(state_->mutex);
    state_->watch();
  }
  std::string reason;
  while (reason.empty() && Clock::now() - begin < patience) {
    std::this_thread::sleep_for(std::min<Seconds>(kLooking, state_->options.beat));
    const std::lock_guard<std::mutex> lock(state_->mutex);
    const std::vector<int> silent = state_->silent_for(kMissedBeats * state_->options.beat);
    if (!state_->failure.empty()) {
      reason = state_->failure;
    } else if (!state_->options.keeper.empty() && !state_->keys_error.empty()) {
      reason = state_->options.keeper + ", which keeps the rendezvous, is gone";
    } else if (!silent.empty()) {
      reason = named(silent) + " died: the connection broke and there are no signs of life, last seen in step " +
               state_->last_step_of(silent.front());
    }
  }
  if (reason.empty()) reason = "a connection between ranks broke although all of them are alive (" + error + ")";
  lose(reason);
}

void Watchdog::leave(const std::string& reason) noexcept {
  try {
    std::unique_lock<std::mutex> lock(state_->mutex);
    if (!state_->leaving.empty() || state_->stop) return;
    state_->leaving = reason.empty() ? "stopped" : reason;
    state_->poke.notify_all();
    if (!state_->options.keeps) state_->left.wait_for(lock, kLeaving, [this] { return state_->gone; });
  } catch (const std::exception& problem) {
    std::fprintf(stderr, "the other ranks could not be told: %s\n", problem.what());
  }
}

}  // namespace anigen::train
