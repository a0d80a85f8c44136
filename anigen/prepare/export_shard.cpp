#include "anigen/prepare/export_shard.h"

#include <memory>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/process.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/io/rigs/shard_writer.h"

namespace anigen::prepare {

namespace {

namespace fs = std::filesystem;

/// The ids that a file of this kind can hold, tried on a file that nobody keeps.
std::vector<std::string> writable(const io::ShapeSource& source, const std::vector<std::string>& ids,
                                  const fs::path& out, ExportSummary& summary) {
  const std::unique_ptr<io::ShardWriter> trial = io::open_shard_writer(out, ids.size());
  std::vector<std::string> good;
  for (const std::string& id : ids) {
    throw_if_interrupted();
    try {
      trial->add(source.read(id), id);
      good.push_back(id);
    } catch (const InputError& error) {
      summary.left_out.push_back(id + ": " + error.what());
      log::warn("left out {}", summary.left_out.back());
    }
  }
  return good;
}

}  // namespace

ExportSummary export_shard(const ExportRequest& request) {
  const std::unique_ptr<io::ShapeSource> source = io::open_source(request.source);
  std::vector<std::string> ids = io::select_ids(*source, request.splits, request.most);
  refuse_to_overwrite({request.out}, [&] {
    std::vector<fs::path> inputs = request.splits;
    for (const std::string& id : ids) {
      for (fs::path& file : source->files(id)) inputs.push_back(std::move(file));
    }
    return inputs;
  });
  ExportSummary summary;
  if (request.keep_going) ids = writable(*source, ids, request.out, summary);
  if (ids.empty()) throw InputError(request.source.string(), "", "none of its rigs can be written");
  const std::unique_ptr<io::ShardWriter> writer = io::open_shard_writer(request.out, ids.size());
  Progress progress("exporting", ids.size(), "rigs");
  for (const std::string& id : ids) {
    throw_if_interrupted();
    writer->add(source->read(id), id);
    ++summary.written;
    progress.advance();
  }
  writer->finish();
  progress.finish();
  return summary;
}

}  // namespace anigen::prepare
