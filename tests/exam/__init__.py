"""An exam of `dynid diagnose` that shares nothing with it: own arms, physics, friction, noise and effects.

Every case is drawn from one integer seed. Seeds below 1000 are for choosing (look at them as often as you like), seeds
from 1000 on are for reporting: they are drawn when the exam is run, and nobody has looked at them before.
`make exam` runs 200 fresh ones and writes docs/measured/exam.md. Nothing here imports the product; it is called as a
user calls it, and its `result.json` is read.

    draw      the numbers of a case, from its seed      arm       links, joints, inertials, and the robot file
    motion    where the joints go                       world     gears, rotors, friction, the states of a run
    sensors   encoders, torque channels, thermometers   declared  what the declared model can imitate
    effects   what an effect is                         frictions, mechanics, channels, outside   effects by kind
    hidden    what is hidden, scaled to the noise       oracle    whether a test that is told the effect sees it
    case      one case in a folder                      examine   one case given to the program
    score     right, false, missed, made worse          tally     figures of many cases
    page      docs/measured/exam.md                              run       the command
"""
