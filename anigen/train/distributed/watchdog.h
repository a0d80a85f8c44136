#pragma once
#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>

#include "anigen/train/distributed/communicator.h"

namespace anigen::train {

/// Finds out which rank is lost. A thread writes this rank's sign of life into shared keys once a second; the signs of
/// the others are read only while somebody waits for them, so that an undisturbed run costs one write per second.
///
/// - A process that died shows by broken connections and missing signs, after 4 s.
/// - One that is stopped, or whose machine is off or cut off, shows by missing signs, after `timeout`.
/// - One that lives but gets nowhere computes while the others wait: after the larger of `timeout` and 5 of the longest
///   step so far; before the first step, after 10 `timeout`.
/// - One that gave up leaves its reason in the keys, and shows at once.
///
/// A rank that says it is busy (Activity) is waited for as long as it gives signs of life.
class Watchdog {
 public:
  using Clock = std::chrono::steady_clock;
  using Seconds = std::chrono::duration<double>;

  struct Options {
    int rank = 0, size = 1;
    Seconds timeout{60.0};
    Seconds beat{1.0};   ///< between signs of life
    std::string keeper;  ///< who keeps the keys: "rank 0"; empty: nobody who could be lost (a file)
    bool keeps = false;  ///< this process does: it must not go before the others have read why
  };

  Watchdog(std::shared_ptr<SharedKeys> keys, const Options& options);
  ~Watchdog();
  Watchdog(const Watchdog&) = delete;
  Watchdog& operator=(const Watchdog&) = delete;

  void report(std::int64_t step, Activity activity);

  /// For whoever waits for others: call about once a second.
  /// @param since when the waiting began @throws RankLost naming the lost ranks, after telling the others
  void check(Clock::time_point since);
  /// After the last check() of a wait.
  void done_waiting();
  /// A connection broke: finds out why, which may take some seconds.
  /// @param error what the connection said @throws RankLost always
  [[noreturn]] void explain(const std::string& error);

  /// See Communicator::leave().
  void leave(const std::string& reason) noexcept;

 private:
  struct Peer;
  struct State;
  static void beat(const std::shared_ptr<State>& state);
  [[noreturn]] void lose(const std::string& reason);

  std::shared_ptr<State> state_;  // shared with the thread, which may be stuck in a dead connection when this ends
  std::thread thread_;
};

}  // namespace anigen::train
