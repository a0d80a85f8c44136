#pragma once
#include <string>
#include <vector>

namespace anigen::train {

/// `anigen-train --ranks N`: the ranks of a run as processes of this machine.
struct LocalRanks {
  int ranks = 1;
  int restarts = 0;       ///< how often all of them are started again after one has failed
  double timeout = 60.0;  ///< seconds in which the others should find out about a lost rank themselves (RankOptions)
};

/// Starts this program so many times with the same words, each told its rank, and waits. A signal to stop is handed on
/// once. When one has failed the others stop by themselves; those that do not within two timeouts are killed. Bad
/// input and an interrupted run are not started again. Ranks find each other by a file in a new folder of the temporary
/// folder, private to the user, which is removed at the end.
/// @param words argv of this program @return the exit status of the first that failed, 1 where a signal ended it; that
/// of bad input where any rank found some, since the others then fail for want of it
/// @throws Error when no process or no folder can be made
int run_local_ranks(const LocalRanks& local, const std::vector<std::string>& words);

}  // namespace anigen::train
