#include "anigen/experiment/clean.h"

#include <set>
#include <system_error>

#include "anigen/core/error.h"
#include "anigen/experiment/folder_size.h"
#include "anigen/experiment/job_record.h"

namespace anigen::experiment {

namespace fs = std::filesystem;

std::vector<Leftover> find_leftovers(const fs::path& out, const Plan& plan) {
  std::set<std::string> planned, found;
  for (const Job& job : plan.jobs) planned.insert(job.id);
  for (const char* part : {"jobs", "records"}) {
    std::error_code error;
    if (!fs::is_directory(out / part, error)) continue;
    for (const auto& entry : fs::directory_iterator(out / part)) {
      const std::string name = entry.is_directory() ? entry.path().filename() : entry.path().stem();
      // Only what this program has named is ever removed.
      if (is_job_id(name) && planned.count(name) == 0) found.insert(name);
    }
  }
  std::vector<Leftover> leftovers;
  for (const std::string& id : found) leftovers.push_back({id, folder_size(out / "jobs" / id)});
  return leftovers;
}

void remove_leftovers(const fs::path& out, const std::vector<Leftover>& leftovers) {
  for (const Leftover& leftover : leftovers) {
    for (const fs::path& path : {out / "jobs" / leftover.id, record_file(out, leftover.id), log_file(out, leftover.id),
                                 worker_logs(out, leftover.id), job_lock_file(out, leftover.id)}) {
      std::error_code error;
      fs::remove_all(path, error);
      if (error) throw Error(path.string() + ": cannot be removed: " + error.message());
    }
  }
}

}  // namespace anigen::experiment
