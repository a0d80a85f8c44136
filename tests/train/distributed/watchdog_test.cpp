#include <gtest/gtest.h>

#include <map>
#include <memory>
#include <mutex>
#include <thread>

#include "anigen/train/distributed/watchdog.h"

namespace anigen::train {
namespace {

using Seconds = Watchdog::Seconds;

/// Keys in memory, which can be taken out of reach.
struct Keys : SharedKeys {
  void set(const std::string& key, const std::string& value) override {
    const std::lock_guard<std::mutex> lock(mutex);
    reach();
    values[key] = value;
  }
  std::optional<std::string> find(const std::string& key) override {
    const std::lock_guard<std::mutex> lock(mutex);
    reach();
    const auto found = values.find(key);
    return found == values.end() ? std::nullopt : std::optional<std::string>(found->second);
  }
  std::int64_t add(const std::string& key, std::int64_t amount) override {
    const std::lock_guard<std::mutex> lock(mutex);
    reach();
    return numbers[key] += amount;
  }
  void reach() const {
    if (gone) throw Error("connection refused");
  }
  std::mutex mutex;
  std::map<std::string, std::string> values;
  std::map<std::string, std::int64_t> numbers;
  bool gone = false;
};

class Watching : public ::testing::Test {
 protected:
  std::unique_ptr<Watchdog> dog(int rank, int size = 3, const std::string& keeper = "") const {
    Watchdog::Options options;
    options.rank = rank;
    options.size = size;
    options.timeout = Seconds(0.5);
    options.beat = Seconds(0.02);
    options.keeper = keeper;
    auto made = std::make_unique<Watchdog>(keys_, options);
    for (const std::int64_t step : {0, 1, 2}) made->report(step, Activity::kTraining);
    return made;
  }
  // Final message of check() when a rank waits, at most so long.
  static std::string outcome(Watchdog& waiting, Seconds most) {
    const auto since = Watchdog::Clock::now();
    try {
      while (Watchdog::Clock::now() - since < most) {
        waiting.check(since);
        std::this_thread::sleep_for(Seconds(0.02));
      }
    } catch (const RankLost& lost) {
      return lost.what();
    }
    waiting.done_waiting();
    return "";
  }
  std::shared_ptr<Keys> keys_ = std::make_shared<Keys>();
};

TEST_F(Watching, ARankWithoutSignsOfLifeIsNamedAndTheOthersSayTheSame) {
  const auto first = dog(0), second = dog(1);
  auto third = dog(2);
  EXPECT_EQ(outcome(*first, Seconds(0.1)), "");
  third.reset();  // its thread ends: nothing more is heard of it
  const std::string said = outcome(*first, Seconds(5.0));
  EXPECT_EQ(said.rfind("rank 2 gave no sign of life", 0), 0u) << said;
  EXPECT_NE(said.find("step 2"), std::string::npos) << said;
  EXPECT_EQ(outcome(*second, Seconds(5.0)), said);
}

TEST_F(Watching, ARankThatGetsNowhereIsNamed) {
  const auto first = dog(0, 2), second = dog(1, 2);
  const std::string said = outcome(*first, Seconds(5.0));
  EXPECT_EQ(said.rfind("rank 1 hangs: still in step 2", 0), 0u) << said;
}

TEST_F(Watching, ABusyRankIsWaitedFor) {
  const auto first = dog(0, 2), second = dog(1, 2);
  second->report(2, Activity::kBusy);
  EXPECT_EQ(outcome(*first, Seconds(1.5)), "") << "three timeouts";
}

TEST_F(Watching, ABrokenConnectionIsExplained) {
  const auto first = dog(0, 2);
  auto second = dog(1, 2);
  std::this_thread::sleep_for(Seconds(0.1));
  second.reset();
  std::string said;
  try {
    first->explain("Connection closed by peer");
  } catch (const RankLost& lost) {
    said = lost.what();
  }
  EXPECT_EQ(said.rfind("rank 1 died", 0), 0u) << said;
}

TEST_F(Watching, WhoeverKeepsTheKeysIsNamedWhenTheyAreGone) {
  const auto second = dog(1, 2, "rank 0");
  {
    const std::lock_guard<std::mutex> lock(keys_->mutex);
    keys_->gone = true;
  }
  const std::string said = outcome(*second, Seconds(5.0));
  EXPECT_EQ(said.rfind("rank 0, which keeps the rendezvous, is gone", 0), 0u) << said;
}

TEST_F(Watching, AReasonReachesTheOthers) {
  const auto first = dog(0, 2), second = dog(1, 2);
  second->leave("rank 1 stopped: out of memory");
  EXPECT_EQ(outcome(*first, Seconds(5.0)), "rank 1 stopped: out of memory");
}

}  // namespace
}  // namespace anigen::train
