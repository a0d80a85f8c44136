#pragma once
#include <cstddef>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/config.h"
#include "anigen/studio/job_runner.h"
#include "anigen/studio/job_store.h"

namespace anigen::studio {

/// A request that cannot be met: HTTP status and the sentence of its {"error": …}.
class RequestError : public std::runtime_error {
 public:
  RequestError(int status, const std::string& problem) : std::runtime_error(problem), status_(status) {}
  int status() const { return status_; }

 private:
  int status_;
};

struct Reply {
  int status = 200;
  std::string type = "application/json", body;
  std::map<std::string, std::string> headers;
};

/// An uploaded file.
struct Upload {
  std::string name;  ///< as the client says it, a path perhaps
  std::string bytes;
};

/// Actions of the routes of the studio (docs/studio.md), without HTTP. Functions may be called from any thread; those
/// that compute take turns. They throw RequestError, InputError for what the client can mend, Error else.
class Api {
 public:
  Api(JobStore& store, JobRunner& runner) : store_(store), runner_(runner) {}

  /// A new job of an image or a mesh. @param options JSON text; empty: defaults
  Reply submit(const Upload& file, const std::string& options);
  Reply list() const;
  /// Number of jobs by state, in the text format of Prometheus.
  Reply metrics() const;
  Reply show(const std::string& id) const;
  Reply cancel(const std::string& id);
  Reply remove(const std::string& id);
  /// rigged or edited .glb .fbx .usdz, preview.png, or "input": the upload.
  Reply file(const std::string& id, const std::string& name);

  /// New skin weights for edited joints, {"joints": [...], "method": "heat"}; writes and returns edited.glb, but with
  /// "draft": true returns the rig alone, without clips, and writes nothing. Headers
  /// X-Bind-Milliseconds and X-Total-Milliseconds.
  Reply rebind(const std::string& id, const std::string& body);
  Reply lint(const std::string& id);
  /// The job's mesh by other methods, {"methods": ["curve", "heat"]}, as new jobs; joints stay with those that need
  /// some.
  Reply compare(const std::string& id, const std::string& body);
  /// Metrics of a job's rig against an uploaded truth.
  Reply evaluate(const std::string& id, const Upload& truth);

 private:
  JobRecord known(const std::string& id) const;
  JobRecord done(const std::string& id) const;
  Json described(const JobRecord& record) const;
  std::shared_ptr<const Asset> asset_of(const std::string& id, const std::string& file);
  void keep_edit(const std::string& id, const std::string& glb) const;
  std::filesystem::path latest(const std::string& id) const;

  JobStore& store_;
  JobRunner& runner_;
  std::mutex computing_;
  std::string loaded_;  ///< file of the asset that is kept
  std::filesystem::file_time_type loaded_time_;
  std::shared_ptr<const Asset> asset_;
};

}  // namespace anigen::studio
