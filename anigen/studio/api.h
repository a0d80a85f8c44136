#pragma once
#include <cstddef>
#include <filesystem>
#include <memory>
#include <mutex>
#include <string>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/config.h"
#include "anigen/studio/job_runner.h"
#include "anigen/studio/job_store.h"
#include "anigen/studio/request.h"

namespace anigen::studio {

/// Actions of the routes of the studio (docs/studio.md), without HTTP. Functions may be called from any thread; those
/// that compute take turns. They throw RequestError, InputError for what the client can mend, Error else.
class Api {
 public:
  Api(JobStore& store, JobRunner& runner) : store_(store), runner_(runner) {}

  /// A new job (submission.h). @param kind one of job_kinds()
  Reply submit(const std::string& kind, const Form& form);
  Reply list() const;
  /// Number of jobs by state, in the text format of Prometheus.
  Reply metrics() const;
  /// Status 200 when it takes jobs, 503 when not.
  Reply ready() const;
  Reply show(const std::string& id) const;
  /// State of a job for those who watch it, to be asked for again and again.
  struct Event {
    std::string data;    ///< the job's JSON
    bool ended = false;  ///< nothing will change any more
  };
  Event event(const std::string& id) const;
  std::size_t most_queued() const { return runner_.most_queued(); }
  /// Cancels a job that waits or runs, removes one that has ended.
  Reply end(const std::string& id);
  /// rigged or edited .glb .fbx .usdz .vrm .zip, preview.png, pictures of a generation, or "input": the upload.
  Reply file(const std::string& id, const std::string& name);

  /// New skin weights for edited joints, {"joints": [...], "method": "heat", "strokes": [...]}; writes and returns
  /// edited.glb, but with "draft": true returns the rig alone, without clips, and writes nothing. Strokes of a brush
  /// (weight_strokes.h) change what was bound, or with method "keep" the weights of the rig. Headers
  /// X-Bind-Milliseconds and X-Total-Milliseconds.
  Reply rebind(const std::string& id, const std::string& body);
  /// New names of a preset for the joints of the latest rig, {"names": "vrm"}; writes and returns edited.glb.
  Reply rename(const std::string& id, const std::string& body);
  Reply lint(const std::string& id);
  /// The job's mesh by other methods, {"methods": ["curve", "heat"]}, as new jobs; joints stay with those that need
  /// some.
  Reply compare(const std::string& id, const std::string& body);

 private:
  JobRecord known(const std::string& id) const;
  Json described(const JobRecord& record) const;
  std::shared_ptr<const Asset> asset_of(const std::string& id, const std::string& file);
  void add_clips(const JobRecord& record, Asset& edit);
  void keep_edit(const std::string& id, const std::string& glb) const;
  std::shared_ptr<const Asset> asset_with(const std::string& id, const Skeleton& skeleton);

  JobStore& store_;
  JobRunner& runner_;
  std::mutex computing_;
  std::string loaded_;  ///< file of the asset that is kept
  std::filesystem::file_time_type loaded_time_;
  std::shared_ptr<const Asset> asset_;
};

}  // namespace anigen::studio
