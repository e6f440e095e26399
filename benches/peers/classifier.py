"""F11: scikit-learn's C-SVC, which is LIBSVM too: training with RBF kernel, and the decision values of a batch."""
import sys
from peer import array, serve
import numpy as np
from sklearn.svm import SVC

folder = sys.argv[1]
price, gamma = array(folder, "parameters", 2)[0]
samples = array(folder, "samples", 5)
features, right = samples[:, :4], samples[:, 4] > 0.5
batch = array(folder, "batch", 4)
machine = SVC(C=price, gamma=gamma, cache_size=200).fit(features, right)


def run(what):
    if what == "train":
        return SVC(C=price, gamma=gamma, cache_size=200).fit(features, right)
    return machine.decision_function(batch)


def told(result):
    if isinstance(result, SVC):
        return {"support_vectors": int(result.n_support_.sum())}
    return {"decisions": result.tolist()}


serve(run, told)
