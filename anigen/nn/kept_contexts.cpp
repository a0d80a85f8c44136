#include "anigen/nn/kept_contexts.h"

namespace anigen::nn {
namespace {

constexpr std::size_t kContexts = 2;  // the condition and its negative

thread_local KeptContexts* innermost = nullptr;

}  // namespace

KeptContexts::KeptContexts() : outer_(innermost) { innermost = this; }

KeptContexts::~KeptContexts() { innermost = outer_; }

std::vector<Tensor> kept(const void* owner, const Tensor& context, const std::function<std::vector<Tensor>()>& make) {
  if (innermost == nullptr || at::GradMode::is_enabled()) return make();
  std::vector<KeptContexts::Entry>& entries = innermost->entries_[owner];
  for (const KeptContexts::Entry& entry : entries) {
    if (entry.context.is_same(context)) return entry.made;
  }
  if (entries.size() == kContexts) entries.erase(entries.begin());
  entries.push_back({context, make()});
  return entries.back().made;
}

}  // namespace anigen::nn
