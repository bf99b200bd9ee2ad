"""Bad recordings of 23 classes, drawn from seeds, and clean ones: what does the program say of them?

The generator shares nothing with the program. Arms, motions and sensors are those of the exam (`tests/exam`); what is
done to a recording is drawn here. Seeds below 1000 are for choosing, seeds from 1000 on for reporting.

    sets      an arm and its runs, clean          story     what is wrong with a set, and what has to be said of it
    clocks    faults of time                      channels  faults of one channel
    wiring    faults of names, signs and units    arm       faults of the arm and its motion
    classes   the list                            judge     an answer against what had to be said
    clean     recordings with nothing wrong       ask       the program
    page      docs/measured/bad_data.md                    run       the command
"""
