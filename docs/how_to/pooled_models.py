"""Compare every arm's own model with the one that knows the other arms, on runs that neither has seen."""

import numpy as np

import dynid_rs as dyn

fleet = dyn.identify_fleet("fleet.toml", "result")  # what is done is not done again
errors = []
for name in fleet.verdicts_:
    own = dyn.TorqueModel.load(f"result/{name}/model.json")
    pooled = fleet.model(name, own)
    run = dyn.read_recording(f"{name}/run_3.csv", own.robot)
    errors.append([np.sqrt(1 - model.score(run)) for model in (own, pooled)])
    pooled.save(f"result/{name}/pooled.json")
alone, together = np.mean(errors, axis=0)
better = sum(pooled < own for own, pooled in errors)
print(f"error over the torque: {100 * alone:.2f} % alone, {100 * together:.2f} % pooled")
print(f"better for {better} of {len(errors)} arms")
