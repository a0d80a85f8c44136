#pragma once
#include <cstddef>
#include <filesystem>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/process.h"

namespace anigen::studio {

enum class JobState { kQueued, kRunning, kDone, kFailed, kCancelled };

/// "queued", "running", "done", "failed", "cancelled".
const char* word(JobState state);
/// Done, failed or cancelled.
bool has_ended(JobState state);

/// Kinds of jobs: "generation" of an image, "rig" of a mesh, "animation" and "evaluation" of a rig.
const std::vector<std::string>& job_kinds();

/// A file that a job is made of.
struct InputFile {
  std::string part;       ///< "file", "truth", "motion", …: for the work
  std::string extension;  ///< such as ".glb"
  std::string bytes;
};

/// One job as its job.json has it.
struct JobRecord {
  std::string id;                             ///< "j000042": its folder's name
  std::string kind;                           ///< one of job_kinds()
  std::string name;                           ///< of the uploaded file, for people
  std::map<std::string, std::string> inputs;  ///< files of the folder, by InputFile::part
  std::map<std::string, std::string> names;   ///< of these files, for people
  Json options = Json::object();
  std::string group;   ///< job that this one is compared with; empty: none
  std::string source;  ///< job whose result this one was made of; empty: none
  JobState state = JobState::kQueued;
  std::string note, error;                             ///< how the rig came about; why it failed
  int starts = 0;                                      ///< how often its work began
  bool cancelling = false;                             ///< it runs, and is to be cancelled
  double created = 0.0, started = 0.0, ended = 0.0;    ///< seconds since 1970; 0: not yet
  Json result = Json::object();                        ///< figures of the rig, for the page
  Json scores = Json::object();                        ///< of an evaluation: values, not_computed, notes
  std::vector<std::pair<std::string, double>> stages;  ///< each with its begin, in seconds after `started`
};

Json to_json(const JobRecord& record);
/// @throws InputError naming file and key
JobRecord job_record_from_json(const Json& json, const std::string& file);

/// Jobs on disk, a folder each with job.json, the upload and what came of it. Every change is a file renamed into
/// place, so that a crash loses at most the step that was going on. All functions may be called from any thread.
class JobStore {
 public:
  /// Reads the jobs of a folder, which is created where there is none. Jobs that were running count as queued again;
  /// those that began `kMostStarts` times and never ended have failed, those that were being cancelled are. A folder
  /// without job.json was never accepted and is removed; one with a damaged job.json is kept and listed as failed.
  /// @throws InputError when another process uses the folder; WriteError
  explicit JobStore(const std::filesystem::path& folder);

  static constexpr int kMostStarts = 2;

  /// Writes a new job; when it returns, the job survives a crash.
  /// @param record with kind, name, options, group and source @param files with "file" among them @throws WriteError
  JobRecord create(JobRecord record, const std::vector<InputFile>& files);

  /// Takes over a copy of a job that ended in another store, as if it had ended now. @param folder of that job
  /// @throws InputError for a folder that holds no such job; WriteError
  JobRecord adopt(const std::filesystem::path& folder);

  std::optional<JobRecord> find(const std::string& id) const;
  /// All jobs, the oldest first.
  std::vector<JobRecord> list() const;
  /// Changes a job on disk and in memory. @return the job, or nothing when there is none of this id @throws WriteError
  std::optional<JobRecord> update(const std::string& id, const std::function<void(JobRecord&)>& change);
  /// Likewise, but in memory alone where the disk refuses the change, which is logged; the next start then finds the
  /// job as it was.
  void update_anyway(const std::string& id, const std::function<void(JobRecord&)>& change);
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

/// Folder in that of a job, for temporary files of its work.
inline constexpr const char* kScratchFolder = "scratch";

/// Removes what a process that was killed left in the folder of its job: temporary and unfinished files, but those that
/// this process is writing.
void remove_leftovers(const std::filesystem::path& folder);

/// Seconds since 1970.
double seconds_now();

}  // namespace anigen::studio
