#pragma once
#include <cstddef>
#include <functional>
#include <map>
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::nn {

/// Cache for sampling: while one lives on a thread and no gradient is recorded, a model that is asked again with the
/// same condition tensor reuses the context it made of it, and its cross attentions reuse their keys and values. The
/// last conditions are kept: two, the condition and its negative, unless more are asked for.
///
/// Tensors are compared by identity: while one lives, change no tensor, weight or type in place, and no number of
/// items.
class ConditionCache {
 public:
  using Tensors = std::vector<Tensor>;
  using Make = std::function<Tensors()>;

  /// @param conditions that are kept of each model, at least 1
  explicit ConditionCache(std::size_t conditions = 2);
  ~ConditionCache();
  ConditionCache(const ConditionCache&) = delete;
  ConditionCache& operator=(const ConditionCache&) = delete;

 private:
  friend Tensor context_of(const void* model, const Tensor& condition, const std::function<Tensor()>& make);
  friend Tensors projected_context(const void* attention, const Tensor& context, const Make& make);
  struct Entry {
    Tensor from;  // held, so that its address is not given to another
    Tensors made;
  };
  using Entries = std::map<const void*, std::vector<Entry>>;  // by owner, the newest last

  const Tensors& look_up(Entries& entries, const void* owner, const Tensor& from, const Make& make) const;
  bool is_context(const Tensor& tensor) const;

  Entries contexts_, projections_;
  std::size_t conditions_;
  ConditionCache* outer_;  // what lived on this thread before
};

/// The context that a model makes of its condition: make(), or what it gave before. The last ones are kept.
Tensor context_of(const void* model, const Tensor& condition, const std::function<Tensor()>& make);

/// Keys and values of a context: make(), or what it gave before for a tensor that context_of() gave.
/// Other contexts, such as another stream's features, are new at every step, and nothing is kept of them.
ConditionCache::Tensors projected_context(const void* attention, const Tensor& context,
                                          const ConditionCache::Make& make);

}  // namespace anigen::nn
