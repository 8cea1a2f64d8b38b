"""scikit-learn's conventions."""

import warnings

import pytest

import mr_damper

checks = pytest.importorskip("sklearn.utils.estimator_checks")

#: Checks of ``check_estimator`` that do not apply. All for one reason: they call ``fit(X, y)`` with an array ``X`` of unnamed columns and a
#: target ``y``. A run has channels with names, units and stamps, and the force is one of them. So ``fit`` refuses ``y``, and refuses an
#: array without names; these checks then see a refusal in place of what they look for. scikit-learn has a tag for such estimators
#: (``two_d_array``), with which ``check_estimator`` leaves these checks out.
NOT_APPLICABLE = {
    "check_complex_data",
    "check_dict_unchanged",
    "check_dont_overwrite_parameters",
    "check_dtype_object",
    "check_estimator_sparse_array",
    "check_estimator_sparse_matrix",
    "check_estimator_sparse_tag",
    "check_estimators_dtypes",
    "check_estimators_empty_data_messages",
    "check_estimators_fit_returns_self",
    "check_estimators_nan_inf",
    "check_estimators_overwrite_params",
    "check_estimators_pickle",
    # The exception is mr_damper.NotFittedError, with the bases of scikit-learn's class but without that class: it is not a dependency.
    "check_estimators_unfitted",
    "check_f_contiguous_array_estimator",
    "check_fit2d_1feature",
    "check_fit2d_1sample",
    "check_fit2d_predict1d",
    "check_fit_check_is_fitted",
    "check_fit_idempotent",
    "check_fit_score_takes_y",
    "check_methods_sample_order_invariance",
    "check_methods_subset_invariance",
    "check_n_features_in",
    "check_n_features_in_after_fitting",
    "check_pipeline_consistency",
    "check_positive_only_tag_during_fit",
    "check_readonly_memmap_input",
    "check_regressor_data_not_an_array",
    "check_regressors_int",
    "check_regressors_no_decision_function",
    "check_regressors_train",
    "check_supervised_y_2d",
}


class WithArrays(mr_damper.DamperModel):
    """Claims to take arrays, so that ``check_estimator`` runs all checks."""

    __init__ = mr_damper.DamperModel.__init__

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.input_tags.two_d_array = True
        return tags


@pytest.mark.filterwarnings("ignore")
def test_check_estimator_passes():
    results = checks.check_estimator(mr_damper.DamperModel("linear"), on_skip=None)
    assert results and {result["status"] for result in results} == {"passed"}


@pytest.mark.filterwarnings("ignore")
def test_the_checks_that_do_not_apply_are_the_listed_ones():
    results = checks.check_estimator(WithArrays("linear"), on_fail=None, on_skip=None)
    failed = {result["check_name"] for result in results if result["status"] == "failed"}
    assert failed == NOT_APPLICABLE
    passed = {result["check_name"] for result in results if result["status"] == "passed"}
    assert passed >= {"check_parameters_default_constructible", "check_get_params_invariance", "check_set_params", "check_estimator_repr"}


def test_a_fitted_model_is_known_as_fitted(fitted):
    from sklearn.base import clone
    from sklearn.exceptions import NotFittedError
    from sklearn.utils.validation import check_is_fitted

    check_is_fitted(fitted)
    with warnings.catch_warnings(), pytest.raises(NotFittedError):
        check_is_fitted(clone(fitted))
