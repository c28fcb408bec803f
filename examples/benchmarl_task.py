"""BenchMARL's MAPPO and QMIX on a scenario: 2,000 steps each, too few for a good policy."""

from tempfile import TemporaryDirectory

from benchmarl.algorithms import MappoConfig, QmixConfig
from benchmarl.experiment import Experiment, ExperimentConfig
from benchmarl.models.mlp import MlpConfig

from smarts.env.benchmarl import HiWayTask


def train(algorithm: type, steps: int, folder: str) -> float:
    """Train an algorithm by BenchMARL, with few steps and small batches; return its mean return by agent."""
    config = ExperimentConfig.get_from_yaml()
    config.max_n_frames, config.save_folder = steps, folder
    config.loggers, config.create_json, config.evaluation, config.render = [], False, False, False
    config.on_policy_collected_frames_per_batch = config.off_policy_collected_frames_per_batch = 500
    config.on_policy_n_envs_per_worker = config.off_policy_n_envs_per_worker = 1
    config.on_policy_minibatch_size, config.on_policy_n_minibatch_iters = 100, 4
    config.off_policy_n_optimizer_steps = 20
    experiment = Experiment(
        task=HiWayTask(["intersection"], agents=4),
        algorithm_config=algorithm.get_from_yaml(),
        model_config=MlpConfig.get_from_yaml(),
        critic_model_config=MlpConfig.get_from_yaml(),
        seed=0,
        config=config,
    )
    experiment.run()
    return experiment.mean_return


def main() -> None:
    """Train both."""
    with TemporaryDirectory() as folder:
        for algorithm in (MappoConfig, QmixConfig):
            print(f"{algorithm.__name__}: {train(algorithm, 2000, folder):.2f}")


if __name__ == "__main__":
    main()
