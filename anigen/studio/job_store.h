#pragma once
#include <cstddef>
#include <filesystem>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/process.h"

namespace anigen::studio {

enum class JobState { kQueued, kRunning, kDone, kFailed, kCancelled };

/// "queued", "running", "done", "failed", "cancelled".
const char* word(JobState state);
/// Done, failed or cancelled.
bool has_ended(JobState state);

/// One job as its job.json has it.
struct JobRecord {
  std::string id;     ///< "j000042": its folder's name
  std::string kind;   ///< "image" or "mesh"
  std::string name;   ///< of the uploaded file, for people
  std::string input;  ///< file of the folder that holds the upload
  Json options = Json::object();
  std::string group;  ///< job that this one is compared with; empty: none
  JobState state = JobState::kQueued;
  std::string note, error;                           ///< how the rig came about; why it failed
  int starts = 0;                                    ///< how often its work began
  double created = 0.0, started = 0.0, ended = 0.0;  ///< seconds since 1970; 0: not yet
  Json result = Json::object();                      ///< figures of the rig, for the page
};

Json to_json(const JobRecord& record);
/// @throws InputError naming file and key
JobRecord job_record_from_json(const Json& json, const std::string& file);

/// Jobs on disk, a folder each with job.json, the upload and what came of it. Every change is a file renamed into
/// place, so that a crash loses at most the step that was going on. All functions may be called from any thread.
class JobStore {
 public:
  /// Reads the jobs of a folder, which is created where there is none. Jobs that were running count as queued again;
  /// those that began `kMostStarts` times and never ended have failed. A folder without job.json was never accepted and
  /// is removed; one with a damaged job.json is kept and listed as failed.
  /// @throws InputError when another process uses the folder; WriteError
  explicit JobStore(const std::filesystem::path& folder);

  static constexpr int kMostStarts = 2;

  /// Writes a new job; when it returns, the job survives a crash.
  /// @param record with kind, name, options and group @param extension of the input file, such as ".glb"
  /// @throws WriteError
  JobRecord create(JobRecord record, const std::string& extension, std::string_view input);

  std::optional<JobRecord> find(const std::string& id) const;
  /// All jobs, the oldest first.
  std::vector<JobRecord> list() const;
  /// Changes a job on disk and in memory. @return the job, or nothing when there is none of this id @throws WriteError
  std::optional<JobRecord> update(const std::string& id, const std::function<void(JobRecord&)>& change);
  /// Removes a job that has ended, with its files. @return false when it has not, or there is none
  bool remove(const std::string& id);

  /// Folder of a job. @pre the id is of a job
  std::filesystem::path folder(const std::string& id) const { return jobs_ / id; }

 private:
  void read_all();
  void write(const JobRecord& record) const;

  std::filesystem::path jobs_;
  std::optional<FileLock> lock_;
  mutable std::mutex mutex_;
  std::map<std::string, JobRecord> records_;
  std::size_t next_ = 1;
};

/// Seconds since 1970.
double seconds_now();

}  // namespace anigen::studio
