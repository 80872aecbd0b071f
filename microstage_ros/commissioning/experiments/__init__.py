"""What is done with the machine in hand: first motion, open loop, closed loop, proof of the law; guarded and
recorded."""
