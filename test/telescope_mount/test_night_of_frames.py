"""A whole night through the reader of frames, against one that the simulator read itself."""


def test_a_night_read_from_frames_is_the_same_night(cli, night, tmp_path):
    out = tmp_path / 'night'
    done = cli('night', '--out', out, '--stars', 8, '--polaris', 4, '--seed', 3,
               '--absolute', 'frames')
    assert done.returncode == 0, (done.stdout, done.stderr)
    for name in ('observations.csv', 'model.json'):
        assert (out / name).read_bytes() == (night / name).read_bytes(), name
    assert (out / 'nodes' / 'frame_reader.params.yaml').is_file()
