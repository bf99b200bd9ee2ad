// libdynid for C++17: handles that free themselves, errors as exceptions. The step itself allocates nothing.
#ifndef DYNID_HPP
#define DYNID_HPP

#include <cstddef>
#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "dynid.h"

namespace dynid {

/// What libdynid refused, with its sentence.
class Error : public std::runtime_error {
public:
    explicit Error(DynidCode code) : std::runtime_error(dynid_last_error()), code_(code) {}
    DynidCode code() const noexcept { return code_; }

private:
    DynidCode code_;
};

inline void check(DynidCode code) {
    if (code != DYNID_CODE_OK) {
        throw Error(code);
    }
}

/// An identified model. Immutable; share it between threads.
class Model {
public:
    static Model load(const std::string &path) {
        DynidModel *model = nullptr;
        check(dynid_model_load(path.c_str(), &model));
        return Model(model);
    }

    static Model parse(const std::string &text) {
        DynidModel *model = nullptr;
        check(dynid_model_parse(reinterpret_cast<const std::uint8_t *>(text.data()), text.size(), &model));
        return Model(model);
    }

    std::size_t n_joints() const { return dynid_model_n_joints(get()); }
    std::size_t n_terms() const { return dynid_model_n_terms(get()); }
    std::string robot_name() const { return text(dynid_model_robot_name(get())); }
    std::string joint_name(std::size_t joint) const { return text(dynid_model_joint_name(get(), joint)); }
    std::string joint_unit(std::size_t joint) const { return text(dynid_model_joint_unit(get(), joint)); }
    std::string term_name(std::size_t term) const { return text(dynid_model_term_name(get(), term)); }
    std::string torque_unit() const { return text(dynid_model_torque_unit(get())); }
    double step() const { return dynid_model_step(get()); }
    const DynidModel *get() const noexcept { return handle_.get(); }

private:
    explicit Model(DynidModel *model) : handle_(model) {}

    static std::string text(const char *found) {
        if (found == nullptr) {
            throw std::out_of_range(dynid_last_error());
        }
        return found;
    }

    struct Free {
        void operator()(DynidModel *model) const noexcept { dynid_model_free(model); }
    };
    std::unique_ptr<DynidModel, Free> handle_;
};

/// Evaluates a model. One per thread; a copy remembers what the original does.
class Estimator {
public:
    /// `step`: time between the states that will come [s], 0 for the model's own.
    explicit Estimator(const Model &model, double step = 0.0)
        : n_joints_(model.n_joints()), n_terms_(model.n_terms()) {
        DynidEstimator *estimator = nullptr;
        check(dynid_estimator_new(model.get(), step, &estimator));
        handle_.reset(estimator);
    }

    Estimator(const Estimator &other) : n_joints_(other.n_joints_), n_terms_(other.n_terms_) {
        DynidEstimator *copy = nullptr;
        check(dynid_estimator_clone(other.handle_.get(), &copy));
        handle_.reset(copy);
    }
    Estimator(Estimator &&) noexcept = default;
    Estimator &operator=(Estimator other) noexcept {
        handle_.swap(other.handle_);
        n_joints_ = other.n_joints_;
        n_terms_ = other.n_terms_;
        return *this;
    }
    ~Estimator() = default;

    /// One step; `tau` must have one value per joint. Returns the status bits.
    std::uint32_t estimate(const DynidState &state, std::vector<double> &tau) {
        std::uint32_t status = 0;
        check(dynid_estimator_estimate(handle_.get(), &state, tau.data(), tau.size(), &status));
        return status;
    }

    /// Torque of every term at the last step, n_terms rows of n_joints; `terms` must be that long.
    void terms(std::vector<double> &terms) const {
        check(dynid_estimator_terms(handle_.get(), terms.data(), terms.size()));
    }

    /// Standard deviation expected at the last step; `std_dev` must have one value per joint.
    void predicted_std(std::vector<double> &std_dev) {
        check(dynid_estimator_predicted_std(handle_.get(), std_dev.data(), std_dev.size()));
    }

    void reset() { check(dynid_estimator_reset(handle_.get())); }
    std::size_t n_joints() const noexcept { return n_joints_; }
    std::size_t n_terms() const noexcept { return n_terms_; }

private:
    struct Free {
        void operator()(DynidEstimator *estimator) const noexcept { dynid_estimator_free(estimator); }
    };
    std::unique_ptr<DynidEstimator, Free> handle_;
    std::size_t n_joints_;
    std::size_t n_terms_;
};

}  // namespace dynid

#endif
