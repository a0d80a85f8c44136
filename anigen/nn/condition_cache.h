#pragma once
#include <functional>
#include <map>
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::nn {

/// While one lives on a thread, a model that is asked there again and again under the same one or two conditions, as by
/// a sampler at every step, keeps what does not depend on the rest: the context that it makes of the condition, and the
/// keys and values that its cross attentions make of the context. Without gradients only.
///
/// A condition is known again by being the same tensor. Whoever changes a tensor, a weight or a model's type in place,
/// or asks for another number of items under one condition, must not hold one of these meanwhile.
class KeptContexts {
 public:
  using Tensors = std::vector<Tensor>;
  using Make = std::function<Tensors()>;

  KeptContexts();
  ~KeptContexts();
  KeptContexts(const KeptContexts&) = delete;
  KeptContexts& operator=(const KeptContexts&) = delete;

 private:
  friend Tensor context_of(const void* model, const Tensor& condition, const std::function<Tensor()>& make);
  friend Tensors projected_context(const void* attention, const Tensor& context, const Make& make);
  struct Entry {
    Tensor from;  // held, so that its address is not given to another
    Tensors made;
  };
  using Entries = std::map<const void*, std::vector<Entry>>;  // by owner, the newest last

  static const Tensors& look_up(Entries& entries, const void* owner, const Tensor& from, const Make& make);
  bool is_context(const Tensor& tensor) const;

  Entries contexts_, projections_;
  KeptContexts* outer_;  // what lived on this thread before
};

/// The context that a model makes of its condition: make(), or what it gave before. The last two are kept.
Tensor context_of(const void* model, const Tensor& condition, const std::function<Tensor()>& make);

/// Keys and values of a context: make(), or what it gave before for a tensor that context_of() gave.
/// Other contexts, such as another stream's features, are new at every step, and nothing is kept of them.
KeptContexts::Tensors projected_context(const void* attention, const Tensor& context, const KeptContexts::Make& make);

}  // namespace anigen::nn
